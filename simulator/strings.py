"""Strings in parallel: accumulators on one pair of rails, which share the current as their voltages demand."""

from __future__ import annotations

import numpy as np

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.cell_data import FloatArray
from simulator.errors import ParameterError

_TOLERANCE_V = 1e-9
_MAX_ITERATIONS = 30


class ParallelStrings:
    """m strings of n cells each. Currents run between strings of unequal charge even when nothing is drawn."""

    def __init__(self, parameters: AccumulatorParameters, n_strings: int, rng: np.random.Generator) -> None:
        if n_strings < 1:
            raise ParameterError("n_strings", n_strings, "at least 1")
        self.strings = tuple(Accumulator(parameters, rng) for _ in range(n_strings))
        self.string_current_a = np.zeros(n_strings)

    @property
    def outlet_voltage_v(self) -> float:
        """Voltage of the common rails [V]."""
        return float(np.mean([string.outlet_voltage_v for string in self.strings]))

    @property
    def soc(self) -> FloatArray:
        """(m, n) SOC of every cell."""
        return np.stack([string.soc for string in self.strings])

    def step(self, dt_s: float, current_a: float, *, fan_duty: float = 0.0) -> None:
        """Advance by `dt_s` with the sum `current_a` drawn [A].

        The shares are those for which all strings END the step at one voltage, found by Newton's method: implicit, so
        that a long step brings strings of unequal charge together and never past each other.
        """
        self.string_current_a = self._shares_a(dt_s, current_a)
        for string, share_a in zip(self.strings, self.string_current_a, strict=True):
            string.step(dt_s, float(share_a), fan_duty=fan_duty)

    def _shares_a(self, dt_s: float, current_a: float) -> FloatArray:
        shares_a: FloatArray = self.string_current_a + (current_a - self.string_current_a.sum()) / len(self.strings)
        for _ in range(_MAX_ITERATIONS):
            voltage_v, slope_ohm = np.array(
                [string.predict(dt_s, float(share)) for string, share in zip(self.strings, shares_a, strict=True)]
            ).T
            rail_v = float((voltage_v / slope_ohm).sum() / (1.0 / slope_ohm).sum())
            shares_a = shares_a + (voltage_v - rail_v) / slope_ohm
            if float(np.abs(voltage_v - rail_v).max()) < _TOLERANCE_V:
                break
        return shares_a
