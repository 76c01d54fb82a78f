"""Bleed resistors: which cells bleed by voltage, and what the LTC6804 lets happen of it.

Voltages come in, on/off per cell goes out; the current itself flows in `simulator.accumulator`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_protocol.ltc6804 import DISCHARGE_MINUTES
from simulator.cell_data import BoolArray, FloatArray

WATCHDOG_S = 2.0


@dataclass(frozen=True)
class ThresholdBleeding:
    """Bleed each cell that stands above the lowest by more than a threshold.

    A gate is driven with (V - V_min) / `difference_v` volts and opens its MOSFET above `gate_threshold_v`, as in the
    balancing thesis; nothing bleeds once the highest cell has reached `stop_v`.
    """

    difference_v: float = 1e-4
    gate_threshold_v: float = 1.0
    stop_v: float = 4.17

    def bleeding(self, voltage_v: FloatArray) -> BoolArray:
        """Return (n,) which cells bleed at the (n,) measured voltages."""
        if voltage_v.max() >= self.stop_v:
            return np.zeros(len(voltage_v), bool)
        gate_v = (voltage_v - voltage_v.min()) / self.difference_v
        chosen: BoolArray = gate_v > self.gate_threshold_v
        return chosen


class Ltc6804Discharge:
    """The rules by which an LTC6804 turns wanted bleeding into bleeding.

    While it measures with discharge not permitted, every output is off. The discharge timer, started by each write of
    the configuration, ends bleeding when it runs out; without a timer the watchdog does, 2 s after the last command.
    """

    def __init__(self, n_cells: int, *, timeout_code: int = 0) -> None:
        self._timeout_s = 60.0 * DISCHARGE_MINUTES[timeout_code]
        self._wanted = np.zeros(n_cells, bool)
        self._off = np.zeros(n_cells, bool)
        self._since_write_s = 0.0
        self._since_command_s = 0.0
        self._measuring_s = 0.0

    def write(self, wanted: BoolArray) -> None:
        """Take a configuration write with these (n,) discharge bits."""
        self._wanted = wanted.copy()
        self._since_write_s = 0.0
        self._since_command_s = 0.0

    def measure(self, conversion_s: float) -> None:
        """Take a conversion command that forbids discharge while it lasts."""
        self._measuring_s = conversion_s
        self._since_command_s = 0.0

    @property
    def is_timed_out(self) -> bool:
        """Whether the timer or the watchdog has ended bleeding."""
        if self._timeout_s > 0.0:
            return self._since_write_s >= self._timeout_s
        return self._since_command_s > WATCHDOG_S

    def step(self, dt_s: float) -> tuple[BoolArray, float]:
        """Advance and return (n,) the outputs of this step and the part of the step that they were on, 0..1."""
        interrupted_s = min(self._measuring_s, dt_s)
        self._measuring_s -= interrupted_s
        self._since_write_s += dt_s
        self._since_command_s += dt_s
        if self.is_timed_out:
            return self._off, 0.0
        return self._wanted, 1.0 - interrupted_s / dt_s if dt_s > 0.0 else 1.0
