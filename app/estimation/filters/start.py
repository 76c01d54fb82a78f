"""Where a filter begins: from one sample of voltages, from a SOC that was handed over, or both."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.errors import ShapeError
from app.estimation.filters.inputs import StepInput
from app.estimation.filters.marginal import SOC_MAX, SOC_MIN
from app.estimation.filters.process import SOC_VARIANCE_MAX
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import BRANCH, PackedCell
from app.estimation.filters.tuning import Tuning

SLOPE_FLOOR_V: Final = 0.02  # least slope by which a voltage error is turned into one of SOC


def start_from_voltage(cell: PackedCell, state: CellStates, tuning: Tuning, step: StepInput) -> None:
    """Set mean and covariance from one sample: SOC from the voltage without the drop, RC currents half of the current.

    How far the RC pairs have followed the current is unknown, and so is the SOC because of it: both share a
    covariance.
    A cell without a voltage starts at the mean of the others (at one half if there are none), as unknown as can be.
    """
    model = cell.model
    v, i = step.voltage_v, step.current_a
    seen = ~np.isnan(v)
    halfway = np.full((model.n_rc, v.size), 0.5 * i)
    soc = np.where(seen, model.ocv.soc_at(v), 0.5)
    for _ in range(3):
        j, f = cell.place_soc(soc)
        c = cell.circuit_at(j, f, step.climate.row, step.climate.row_weight)
        soc = np.where(seen, model.ocv.soc_at(v + state.resistance * cell.drop(c, i, halfway)), soc)
    soc = np.where(seen, soc, soc[seen].mean() if seen.any() else 0.5)
    slope = np.maximum(model.ocv.slope(soc), SLOPE_FLOOR_V)
    branch_v2 = (tuning.start_branch_c * model.c_rate_a) ** 2 + (tuning.start_branch_rel * i) ** 2
    P = state.cov
    P[:] = 0.0
    z = step.noise_v2 * step.climate.noise_scale / slope**2 + tuning.start_voltage_sigma**2
    for k in range(model.n_rc):
        share = state.resistance * c[BRANCH + k] / slope
        z += share * share * branch_v2
        P[SOC, k + 1] = P[k + 1, SOC] = share * branch_v2 * seen
        P[k + 1, k + 1] = branch_v2
    P[SOC, SOC] = np.where(seen, z, SOC_VARIANCE_MAX)
    shrink = np.sqrt(np.minimum(1.0, SOC_VARIANCE_MAX / P[SOC, SOC]))
    P[SOC] *= shrink
    P[:, SOC] *= shrink
    state.mean[1:] = halfway
    state.mean[SOC] = np.clip(soc, SOC_MIN, SOC_MAX)
    state.hysteresis[:] = 0.0
    state.refused_s[:] = 0.0
    state.averages[:] = 0.0
    state.bias_v2[:] = tuning.bias_start_v**2


def impose_soc(state: CellStates, soc: FloatArray, sigma: FloatArray) -> None:
    """Replace the SOC of a fresh state where one is given (not NaN), and forget what tied it to the RC currents."""
    given = ~np.isnan(soc)
    state.mean[SOC] = np.where(given, np.clip(soc, SOC_MIN, SOC_MAX), state.mean[SOC])
    state.cov[SOC, 1:] *= ~given
    state.cov[1:, SOC] *= ~given
    variance = np.clip(sigma * sigma, 1e-8, SOC_VARIANCE_MAX)
    state.cov[SOC, SOC] = np.where(given, variance, state.cov[SOC, SOC])


def initial_soc_sigma(
    cell: PackedCell, state: CellStates, tuning: Tuning, step: StepInput, soc: FloatArray, sigma: FloatArray
) -> FloatArray:
    """Return (n,) sigma of a given initial SOC: `sigma`; where that is NaN, use the resting voltage to judge it."""
    off = np.abs(state.mean[SOC] - soc)
    at_rest = ~np.isnan(step.voltage_v) & (abs(step.current_a) < tuning.rest_c * cell.model.c_rate_a)
    off_v = np.abs(cell.ocv_of(state.mean[SOC]) - cell.ocv_of(soc))
    is_off = at_rest & (off_v > tuning.rest_error_v) & (off < tuning.rest_off_max)
    return np.where(np.isnan(sigma), np.where(is_off, off, tuning.counter_soc_sigma), sigma)


def start_count(state: CellStates, soc: FloatArray, sigma: FloatArray) -> None:
    """Start the charge count at the SOC given, or where that is NaN at what the voltage said."""
    given = ~np.isnan(soc)
    state.count[:] = 0.0
    state.count_soc[:] = np.where(given, np.clip(soc, SOC_MIN, SOC_MAX), state.mean[SOC])
    state.anchor_v2[:] = np.where(given, np.clip(sigma * sigma, 1e-8, SOC_VARIANCE_MAX), state.cov[SOC, SOC])
    state.doubt_s[:] = 0.0
    state.apart[:] = state.mean[SOC] - state.count_soc
    state.wander_v2[:] = 0.0


def per_cell(name: str, values: ArrayLike | None, default: float, n_cells: int) -> FloatArray:
    """Return a scalar or (n_cells,) argument as (n_cells,); `default` everywhere for None.

    Raises:
        ShapeError: it is neither.
    """
    array = np.asarray(default if values is None else values, dtype=np.float64)
    if array.shape not in ((), (n_cells,)):
        raise ShapeError(name, (n_cells,), array.shape)
    return np.array(np.broadcast_to(array, (n_cells,)))
