"""The recursive filters behind one interface: EKF, UKF and CDKF, all cells at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.estimation.circuit import CellModel
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.estimates import Estimates
from app.estimation.inputs import InputGuard
from app.estimation.marginal import (
    SOC,
    SOC_MAX,
    SOC_MIN,
    SOC_VARIANCE_MAX,
    FilterState,
    MarginalFilter,
    StepInput,
    StepResult,
)
from app.estimation.self_check import SelfCheck
from app.estimation.sigma_points import SigmaRule
from app.estimation.tables import BRANCH, OVERPOTENTIAL, R0, PackedCell
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]

SLOPE_FLOOR_V = 0.02  # least slope by which a voltage error is turned into one of SOC


class GaussianEstimator:
    """A marginalised filter over n_cells cells; `rule` None makes it the extended Kalman filter."""

    def __init__(self, model: CellModel, n_cells: int, rule: SigmaRule | None, tuning: Tuning) -> None:
        self.model = model
        self.tuning = tuning
        self.cell = PackedCell(model)
        self.guard = InputGuard(self.cell, n_cells, tuning)
        self.filter = MarginalFilter(self.cell, rule, tuning)
        self.state: FilterState | None = None
        self._check = SelfCheck(n_cells, tuning)
        self._n_cells = n_cells

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self._n_cells

    @property
    def state_mean(self) -> FloatArray:
        """(n_states, n_cells) SOC, then RC currents [A]; a copy."""
        return self.started().mean.copy()

    @property
    def state_cov(self) -> FloatArray:
        """(n_cells, n_states, n_states) covariance; a copy."""
        return np.moveaxis(self.started().cov, 2, 0).copy()

    def started(self) -> FilterState:
        """Return the state; EstimatorError before `start`."""
        if self.state is None:
            raise EstimatorError("the filter has not been started")
        return self.state

    def start(
        self,
        voltages_v: ArrayLike,
        temperatures_degc: ArrayLike,
        current_a: float,
        soc: ArrayLike | None = None,
        soc_sigma: ArrayLike | None = None,
    ) -> None:
        """Set the state from one sample; see `CellEstimator.start`."""
        step = self.guard.check(0.0, current_a, voltages_v, temperatures_degc)
        self.state = start_state(self.cell, self.tuning, step)
        self._check = SelfCheck(self._n_cells, self.tuning)
        if soc is not None:
            given = per_cell("soc", soc, self._n_cells)
            sigma = per_cell(
                "soc_sigma", self.tuning.start_soc_sigma if soc_sigma is None else soc_sigma, self._n_cells
            )
            impose_soc(self.state, given, sigma)

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> Estimates:
        """Return the estimates after one sample; see `CellEstimator.step`."""
        state = self.started()
        sample = self.guard.check(dt_s, current_a, voltages_v, temperatures_degc)
        self.filter.predict(state, sample)
        result = self.filter.update(state, sample)
        return self.report(sample, result)

    def report(self, sample: StepInput, result: StepResult) -> Estimates:
        """Return what the state and the last update say."""
        state = self.started()
        soc = state.mean[SOC]
        j, f = self.cell.place_soc(soc)
        return Estimates(
            soc=np.minimum(np.maximum(soc, 0.0), 1.0),
            soc_sigma=np.sqrt(soc_variance(state, result, self.tuning)),
            ocv_v=self.cell.ocv_at(j, f),
            voltage_v=result.predicted_v,
            innovation_v=result.innovation_v,
            innovation_sigma_v=result.innovation_sigma_v,
            model_valid=self._check.step(sample.dt_s, result.innovation_v, sample.noise_v2),
            accepted=result.accepted,
        )


def soc_variance(state: FilterState, result: StepResult, tuning: Tuning) -> FloatArray:
    """Return (n,) variance of the SOC with the error that averaging does not remove: P_zz + (bias / slope)^2."""
    bias = tuning.bias_v / np.maximum(np.abs(result.slope_v), SLOPE_FLOOR_V)
    return np.asarray(np.minimum(state.cov[SOC, SOC] + bias * bias, SOC_VARIANCE_MAX))


def start_state(cell: PackedCell, tuning: Tuning, step: StepInput) -> FilterState:
    """Return the state read off one sample: SOC from the voltage less the ohmic drop, RC currents unknown.

    The drop over the RC pairs is unknown and so is the SOC because of it: both share a covariance.
    A cell without a voltage starts at the mean of the others (at one half if there are none), as unknown as can be.
    """
    n = step.voltage_v.size
    model = cell.model
    v, i = step.voltage_v, step.current_a
    soc = np.where(np.isnan(v), 0.5, model.ocv.soc_at(v))
    over = np.arcsinh(i / model.overpotential_current_a)
    for _ in range(3):
        j, f = cell.place_soc(soc)
        c = cell.circuit_at(j, f, step.row, step.row_weight)
        soc = np.where(np.isnan(v), soc, model.ocv.soc_at(v + i * c[R0] + over * c[OVERPOTENTIAL]))
    seen = ~np.isnan(v)
    soc = np.where(seen, soc, soc[seen].mean() if seen.any() else 0.5)
    slope = np.maximum(model.ocv.slope(soc), SLOPE_FLOOR_V)
    branch_v2 = (tuning.start_branch_c * model.c_rate_a) ** 2 + i * i
    d = 1 + model.n_rc
    P = np.zeros((d, d, n))
    z = np.zeros(n)
    for k in range(model.n_rc):
        share = c[BRANCH + k] / slope
        z += share * share * branch_v2
        P[SOC, k + 1] = P[k + 1, SOC] = share * branch_v2
        P[k + 1, k + 1] = branch_v2
    P[SOC, SOC] = z + step.noise_v2 * step.noise_scale / slope**2 + 1e-6
    shrink = np.sqrt(np.minimum(1.0, SOC_VARIANCE_MAX / P[SOC, SOC]))
    P[SOC] *= shrink
    P[:, SOC] *= shrink
    P[SOC, 1:] *= seen
    P[1:, SOC] *= seen
    P[SOC, SOC] = np.where(seen, P[SOC, SOC], SOC_VARIANCE_MAX)
    mean = np.zeros((d, n))
    mean[SOC] = np.clip(soc, SOC_MIN, SOC_MAX)
    return FilterState(mean, P, np.zeros(n), np.zeros(n))


def impose_soc(state: FilterState, soc: FloatArray, sigma: FloatArray) -> None:
    """Replace the SOC of a fresh state where one is given (not NaN), and forget what tied it to the RC currents."""
    given = ~np.isnan(soc)
    state.mean[SOC] = np.where(given, np.clip(soc, SOC_MIN, SOC_MAX), state.mean[SOC])
    state.cov[SOC, 1:] *= ~given
    state.cov[1:, SOC] *= ~given
    variance = np.clip(sigma * sigma, 1e-8, SOC_VARIANCE_MAX)
    state.cov[SOC, SOC] = np.where(given, variance, state.cov[SOC, SOC])


def per_cell(name: str, values: ArrayLike, n_cells: int) -> FloatArray:
    """Return a scalar or (n_cells,) argument as (n_cells,).

    Raises:
        ShapeError: it is neither.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.shape not in ((), (n_cells,)):
        raise ShapeError(name, (n_cells,), array.shape)
    return np.array(np.broadcast_to(array, (n_cells,)))
