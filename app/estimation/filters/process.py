"""What happens to a state between two samples: everything that moves is linear, so one product and one sum do it.

    z' = z - m,   i_k' = a_k i_k + (1 - a_k) i,   a_k = exp(-dt / tau_k)      m = share of the capacity moved
    P' = A P A' + Q,   h' = f h - sign(m) (1 - f),   f = exp(-rate |m|)       A = diag(1, a_1 ..), held current

The charge count and the sigmas that gain and offset of the sensor give it are rows of the same state.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR
from app.estimation.filters.inputs import StepInput
from app.estimation.filters.states import COUNT, COUNT_GAIN, COUNT_OFFSET, HYSTERESIS, SOC, CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning

SOC_VARIANCE_MAX: Final = 0.25  # no cell's SOC is less known than this
VARIANCE_STEP: Final = 1e-12  # added at every step, in units of 1 and C^2: the floor of definiteness
KEPT_STEPS: Final = 64  # step lengths whose factors are kept; a stream has a handful


class _Factors(NamedTuple):
    """What depends on the step length alone; with time constants over SOC a row of them is (n,)."""

    rows: FloatArray  # (n_moving, n) the product
    walk: float  # what the SOC's variance grows by
    rests: list[tuple[float | FloatArray, float | FloatArray]]  # 1 - a_k, 1 - a_k^2


class Process:
    """Moves the states of one cell model; `counts` also moves the charge count."""

    def __init__(self, cell: PackedCell, states: CellStates, tuning: Tuning, counts: bool) -> None:
        self._cell = cell
        self._states = states
        self._tuning = tuning
        self._counts = counts
        self._slow = states.mean.shape[0] * (1 + states.mean.shape[0])  # row of HYSTERESIS
        c_rate_a = cell.model.c_rate_a
        self._branch_floor_v2 = (tuning.branch_c * c_rate_a) * (tuning.branch_c * c_rate_a)
        self._current_floor_v2 = VARIANCE_STEP * (c_rate_a * c_rate_a)
        rows = states.moving.shape[0]
        is_fixed = cell.tau_fixed_s is not None
        self._change = np.zeros(rows if is_fixed else (rows, states.n_cells))
        self._changes = self._change[:, None] if is_fixed else self._change, np.empty(states.moving.shape)
        self._kept: dict[float, _Factors] = {}

    def moved_soc(self, current_a: float, dt_s: float) -> float:
        """Return the share of the capacity that a held current takes out; charging counts times the efficiency."""
        model = self._cell.model
        kept = model.coulombic_efficiency if current_a < 0.0 else 1.0
        return kept * current_a * dt_s / (SECONDS_PER_HOUR * model.capacity_ah)

    def predict(self, step: StepInput) -> None:
        """Move the state over one step of held current, in place."""
        tuning, change, slow, i = self._tuning, self._change, self._slow, step.current_a
        d = self._states.mean.shape[0]
        factors = self._kept.get(step.dt_s) or self._factors(step)
        moved = self.moved_soc(i, step.dt_s)
        if self._cell.model.hysteresis_v:
            follow = math.exp(-self._cell.model.hysteresis_rate * abs(moved))
            factors.rows[slow + HYSTERESIS] = follow
            change[slow + HYSTERESIS] = -math.copysign(1.0 - follow, moved)
        branch_a = tuning.branch_rel * i
        branch_variance = branch_a * branch_a + self._branch_floor_v2
        change[SOC] = -moved
        change[d] = factors.walk
        for k, (rest, rest2) in enumerate(factors.rests, 1):
            change[k] = rest * i
            change[d + k * (d + 1)] = rest2 * branch_variance + self._current_floor_v2
        if self._counts:
            change[slow + COUNT] = -moved
            change[slow + COUNT_GAIN] = tuning.counter_gain * moved
            change[slow + COUNT_OFFSET] = tuning.counter_offset_c / SECONDS_PER_HOUR * step.dt_s
        moving = self._states.moving
        change_of_each, added = self._changes
        added[...] = change_of_each
        np.multiply(moving, factors.rows, moving)
        np.add(moving, added, moving)

    def _factors(self, step: StepInput) -> _Factors:
        cell, states, dt = self._cell, self._states, step.dt_s
        walk = min(self._tuning.soc_walk * self._tuning.soc_walk * dt, SOC_VARIANCE_MAX) + VARIANCE_STEP
        d = states.mean.shape[0]
        A = np.ones((d, states.n_cells))
        decay: list[float] | list[FloatArray]
        if cell.tau_fixed_s is not None:
            decay = [math.exp(-dt / tau) for tau in cell.tau_fixed_s.tolist()]
            A[1:] = np.array(decay)[:, None]
        else:
            j, f = cell.place_soc(states.mean[SOC])
            A[1:] = _exp(-dt / cell.tau_at(j, f, step.climate.row, step.climate.row_weight))
            decay = list(A[1:].copy())
        rows = np.ones(states.moving.shape)
        rows[:d] = A
        # what multiplies P keeps the SOC's variance below its maximum
        A[SOC] = math.sqrt(max(1.0 - walk / SOC_VARIANCE_MAX, 0.0))
        rows[d : d + d * d] = (A[:, None] * A).reshape(d * d, -1)
        factors = _Factors(rows, walk, [(1.0 - a, 1.0 - a * a) for a in decay])
        if cell.tau_fixed_s is not None:
            if len(self._kept) >= KEPT_STEPS:
                self._kept.clear()
            self._kept[dt] = factors
        return factors


def _exp(x: FloatArray) -> FloatArray:
    """Return exp(x) to the last bit as the C library, and so the compiled engine, has it."""
    return np.array([math.exp(value) for value in x.ravel().tolist()]).reshape(x.shape)
