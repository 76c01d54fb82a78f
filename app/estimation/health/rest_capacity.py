"""Capacity of every cell from what was counted between two rests, whose SOC the voltage tells."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.health.capacity import SOC_MOVED_MIN, CapacityTracker

REST_A: Final = 1.0  # below, no current flows: what is left is the sensor's noise and offset
REST_S: Final = 120.0  # then the RC pairs have settled to a few millivolts
REST_SOC_SIGMA: Final = 0.015
COUNT_GAIN_SIGMA: Final = 0.005  # of the charge counted
COUNT_OFFSET_A: Final = 0.5  # of the current sensor


class CapacityBetweenRests:
    """Counts charge from rest to rest and tells the tracker."""

    def __init__(self, cell: CellModel, tracker: CapacityTracker) -> None:
        self._cell = cell
        self.tracker = tracker
        self._rest_s = 0.0
        self._charge_ah = 0.0
        self._elapsed_s = 0.0
        self._anchor: FloatArray | None = None

    def step(self, dt_s: float, current_a: float, voltages_v: FloatArray) -> bool:
        """Count; True where a rest closed a stretch and the capacities are new.

        Args:
            dt_s: since the last sample [s].
            current_a: positive on discharge [A].
            voltages_v: (n_cells,) [V]; NaN = missing.
        """
        self._charge_ah += current_a * dt_s / SECONDS_PER_HOUR
        self._elapsed_s += dt_s
        self._rest_s = self._rest_s + dt_s if abs(current_a) < REST_A else 0.0
        if self._rest_s < REST_S:
            return False
        self._rest_s = 0.0
        soc = self._cell.ocv.soc_at(voltages_v)
        if self._anchor is None:
            self._begin(soc)
            return False
        moved = self._anchor - soc
        if not (np.abs(moved) >= SOC_MOVED_MIN).any():
            return False  # go on counting from the older rest
        sigma_ah = abs(self._charge_ah) * COUNT_GAIN_SIGMA + COUNT_OFFSET_A * self._elapsed_s / SECONDS_PER_HOUR + 1e-3
        self.tracker.observe(moved, REST_SOC_SIGMA * np.sqrt(2.0), self._charge_ah, sigma_ah)
        self._begin(soc)
        return True

    def _begin(self, soc: FloatArray) -> None:
        self._anchor = soc
        self._charge_ah = self._elapsed_s = 0.0
