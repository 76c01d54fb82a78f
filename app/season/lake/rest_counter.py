"""The charge that a session counts between its rests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from app.analysis.survey import Piece
from app.analysis.totals import MAX_STEP_S
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.capacity import CapacityTracker
from app.estimation.health.rest_capacity import CapacityBetweenRests


@dataclass(frozen=True)
class Stretch:
    """Charge counted between two rests: (n_cells,) change of SOC, its sigma, charge and its sigma [Ah]."""

    soc_moved: FloatArray
    soc_moved_sigma: float
    charge_ah: float
    charge_sigma_ah: float


class _Stretches(CapacityTracker):
    """A tracker that keeps what it is given."""

    def __init__(self, nominal_ah: float, n_cells: int) -> None:
        super().__init__(nominal_ah, n_cells)
        self.stretches: list[Stretch] = []

    def observe(
        self, soc_moved: ArrayLike, soc_moved_sigma: ArrayLike, charge_ah: ArrayLike, charge_sigma_ah: ArrayLike
    ) -> None:
        self.stretches.append(
            Stretch(
                np.array(soc_moved, dtype=np.float64),
                float(np.asarray(soc_moved_sigma)),
                float(np.asarray(charge_ah)),
                float(np.asarray(charge_sigma_ah)),
            )
        )


class RestCounter:
    """Counts the charge between the rests of a session, piece by piece."""

    def __init__(self, cell: CellModel, n_cells: int) -> None:
        self._tracker = _Stretches(cell.capacity_ah, n_cells)
        self._rests = CapacityBetweenRests(cell, self._tracker)
        self._last_s: float | None = None

    def add(self, piece: Piece) -> None:
        """Take the next piece."""
        for at_s, current_a, volts in zip(
            piece.time_s.tolist(), piece.current_a.tolist(), piece.voltage_v, strict=True
        ):
            dt_s = 0.0 if self._last_s is None else at_s - self._last_s
            self._last_s = at_s
            if current_a == current_a and 0.0 <= dt_s <= MAX_STEP_S:
                self._rests.step(dt_s, current_a, volts)

    @property
    def stretches(self) -> list[Stretch]:
        """What was counted between two rests, in order."""
        return self._tracker.stretches
