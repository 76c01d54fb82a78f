"""Strings in parallel: accumulators on one pair of rails, which share the current as their voltages demand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.cell_data import FloatArray
from simulator.errors import ConvergenceError, ParameterError

_TOLERANCE_V = 1e-9
_MAX_ITERATIONS = 12  # of Newton's method, which needs three or four where it converges at all
_MAX_BRACKETINGS = 200


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
        that a long step brings strings of unequal charge together and never past each other. Where the bends of the
        equilibrium curve keep it from converging, the voltage of the rails is bracketed instead.

        Raises:
            ConvergenceError: neither brought the rails together.
        """
        self.string_current_a = self._shares_a(dt_s, current_a)
        for string, share_a in zip(self.strings, self.string_current_a, strict=True):
            string.step(dt_s, float(share_a), fan_duty=fan_duty)

    def _shares_a(self, dt_s: float, current_a: float) -> FloatArray:
        start_a: FloatArray = self.string_current_a + (current_a - self.string_current_a.sum()) / len(self.strings)
        shares_a = start_a
        for _ in range(_MAX_ITERATIONS):
            voltage_v, slope_ohm = np.array(
                [string.predict(dt_s, float(share)) for string, share in zip(self.strings, shares_a, strict=True)]
            ).T
            rail_v = float((voltage_v / slope_ohm).sum() / (1.0 / slope_ohm).sum())
            if float(np.abs(voltage_v - rail_v).max()) < _TOLERANCE_V:
                return shares_a
            shares_a = shares_a + (voltage_v - rail_v) / slope_ohm
        return self._bracketed_shares_a(dt_s, current_a, start_a)

    def _bracketed_shares_a(self, dt_s: float, current_a: float, start_a: FloatArray) -> FloatArray:
        """Return the shares at the one rail voltage for which they add up: every string gives less at a higher one."""
        shares_a = start_a.copy()
        slopes_ohm = np.ones_like(shares_a)

        def missing_v(rail_v: float) -> tuple[float, float]:
            for k, string in enumerate(self.strings):
                shares_a[k], slopes_ohm[k] = _share_at(string, dt_s, rail_v, float(shares_a[k]))
            return (float(shares_a.sum()) - current_a) / float((1.0 / slopes_ohm).sum()), 1.0

        _root_of_falling(missing_v, self.outlet_voltage_v)
        missing_a = current_a - shares_a.sum()  # what the tolerance left
        left_a: FloatArray = shares_a + missing_a / slopes_ohm / (1.0 / slopes_ohm).sum()
        return left_a


def _share_at(string: Accumulator, dt_s: float, rail_v: float, start_a: float) -> tuple[float, float]:
    """Return the current at which a string ends the step at the voltage of the rails, and -dV/dI there [ohm]."""
    slope_ohm = 0.0

    def excess_v(current_a: float) -> tuple[float, float]:
        nonlocal slope_ohm
        voltage_v, slope_ohm = string.predict(dt_s, current_a)
        return voltage_v - rail_v, slope_ohm

    return _root_of_falling(excess_v, start_a), slope_ohm


def _root_of_falling(function: Callable[[float], tuple[float, float]], start: float) -> float:
    """Return where a falling function is 0, by Newton's steps inside a bracket that shrinks.

    Args:
        function: gives its value and how steeply it falls, > 0.
        start: where to begin.

    Raises:
        ConvergenceError: it is not found.
    """
    low, high, x, reach, last = -np.inf, np.inf, start, 1.0, np.inf
    for _ in range(_MAX_BRACKETINGS):
        value, slope = function(x)
        if abs(value) < _TOLERANCE_V:
            return x
        low, high = (x, high) if value > 0.0 else (low, x)
        step = value / slope
        if np.isinf(high - low):
            step, reach = min(max(step, -reach), reach), 2.0 * reach
            x += step
        elif abs(value) < 0.5 * last and low < x + step < high:
            x += step
        else:
            x = 0.5 * (low + high)
        last = abs(value)
    raise ConvergenceError("rail voltage", value)
