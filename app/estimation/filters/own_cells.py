"""Cells with a capacity and resistances of their own, which they differ by from their common model.

    z -= eta i dt / 3600 (1 / C_own - 1 / C_model)

taken before a step. What moves afterwards is linear, so the two add up and no filter has to know. Resistances enter
where a voltage is predicted: every drop of a cell is so many times that of the model.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel, charge_moved_coulomb
from app.estimation.errors import EstimatorError
from app.estimation.filters.start import per_cell
from app.estimation.filters.states import SOC, CellStates


class OwnCapacity:
    """Capacities of the cells of one state; the model's until `use` says otherwise."""

    def __init__(self, model: CellModel, states: CellStates) -> None:
        self._model = model
        self._states = states
        self._beyond: FloatArray | None = None

    def use(self, capacity_ah: ArrayLike) -> None:
        """Count with these from now on; see `CellEstimator.use_capacity`."""
        own = _positive("capacity_ah", capacity_ah, self._states.n_cells)
        beyond = 1.0 / own - 1.0 / self._model.capacity_ah
        self._beyond = beyond if beyond.any() else None

    @property
    def is_used(self) -> bool:
        """Whether a cell has another capacity than the model."""
        return self._beyond is not None

    def take(self, current_a: float, dt_s: float) -> None:
        """Prepare for a step of held current: current in force [A], step [s]."""
        if self._beyond is not None:
            moved_ah = float(charge_moved_coulomb(self._model, current_a, dt_s)) / SECONDS_PER_HOUR
            moved = moved_ah * self._beyond
            self._states.mean[SOC] -= moved
            self._states.count_soc -= moved


def use_resistance(states: CellStates, factor: ArrayLike) -> None:
    """Let the cells of one state resist so many times what their model says; see `CellEstimator.use_resistance`."""
    states.resistance[:] = _positive("factor", factor, states.n_cells)
    states.has_resistance = bool((states.resistance != 1.0).any())


def _positive(name: str, values: ArrayLike, n_cells: int) -> FloatArray:
    own = per_cell(name, values, np.nan, n_cells)
    if not (np.isfinite(own).all() and (own > 0.0).all()):
        raise EstimatorError(f"{name} has to be finite and positive")
    return own
