"""The filters behind one interface: EKF, UKF, CDKF, and the fusion of one of them with a charge count."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.estimation.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.estimation.estimates import Estimates
from app.estimation.fusion import fuse, move_count
from app.estimation.inputs import InputGuard
from app.estimation.marginal import SOC_VARIANCE_MAX, MarginalFilter, StepResult
from app.estimation.record import Record, check_record, run_steps
from app.estimation.self_check import check_model
from app.estimation.sigma_points import SigmaRule
from app.estimation.start import SLOPE_FLOOR_V, impose_soc, per_cell, start_count, start_from_voltage
from app.estimation.states import SOC, CellStates
from app.estimation.tables import PackedCell
from app.estimation.tuning import Tuning

if TYPE_CHECKING:
    from app.estimation.fast import FastStep

FloatArray = NDArray[np.float64]
Engine = Literal["auto", "numpy", "numba"]


class GaussianEstimator:
    """A marginalised filter over n_cells cells, alone or fused with a charge count.

    Alone, it starts from the SOC it is given. Fused, the filter starts from the voltage and the count from the SOC.
    """

    def __init__(
        self,
        model: CellModel,
        n_cells: int,
        rule: SigmaRule | None,
        tuning: Tuning,
        fused: bool = False,
        engine: Engine = "auto",
    ) -> None:
        self.model = model
        self.tuning = tuning
        self.fused = fused
        self.cell = PackedCell(model)
        self.states = CellStates(model.n_rc, n_cells)
        self.guard = InputGuard(self.cell, self.states, tuning)
        self.filter = MarginalFilter(self.cell, rule, tuning)
        self._fast = _fast_step(self.cell, self.states, rule, tuning, fused) if wants_numba(engine) else None
        self._is_started = False

    @property
    def engine(self) -> str:
        """What computes: "numba" or "numpy"."""
        return "numpy" if self._fast is None else "numba"

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.states.n_cells

    @property
    def state_mean(self) -> FloatArray:
        """(n_states, n_cells) of the filter: SOC, then RC currents [A]; a copy."""
        return self.states.mean.copy()

    @property
    def state_cov(self) -> FloatArray:
        """(n_cells, n_states, n_states) of the filter; a copy."""
        return np.array(np.moveaxis(self.states.cov, 2, 0))

    @property
    def counted_soc(self) -> FloatArray:
        """(n_cells,) SOC of the charge count, where there is one; a copy."""
        return np.array(self.states.count_soc)

    def start(
        self,
        voltages_v: ArrayLike,
        temperatures_degc: ArrayLike,
        current_a: float,
        soc: ArrayLike | None = None,
        soc_sigma: ArrayLike | None = None,
    ) -> None:
        """Set the state from one sample; see `CellEstimator.start`."""
        n, tuning = self.n_cells, self.tuning
        given = per_cell("soc", soc, np.nan, n)
        sigma = per_cell("soc_sigma", soc_sigma, tuning.counter_soc_sigma if self.fused else tuning.start_soc_sigma, n)
        sample = self.guard.check(0.0, current_a, voltages_v, temperatures_degc)
        start_from_voltage(self.cell, self.states, tuning, sample)
        if self.fused:
            start_count(self.states, given, sigma)
        else:
            impose_soc(self.states, given, sigma)
        self._is_started = True

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> Estimates:
        """Return the estimates after one sample; see `CellEstimator.step`."""
        self.require_start()
        if self._fast is not None:
            guard = self.guard
            current = guard.common(dt_s, current_a)
            voltages, temperatures = (
                guard.array("voltages_v", voltages_v),
                guard.array("temperatures_degc", temperatures_degc),
            )
            return self._fast.step(dt_s, current, voltages, temperatures)
        state, tuning = self.states, self.tuning
        sample = self.guard.check(dt_s, current_a, voltages_v, temperatures_degc)
        self.filter.predict(state, sample)
        result = self.filter.update(state, sample)
        soc, variance = state.mean[SOC], soc_variance(state, result, tuning)
        if self.fused:
            move_count(state, tuning, self.filter.moved_soc(sample.current_a, sample.dt_s), sample.dt_s)
            soc, variance = fuse(state, tuning, sample.dt_s, variance)
        return Estimates(
            soc=np.minimum(np.maximum(soc, 0.0), 1.0),
            soc_sigma=np.sqrt(variance),
            ocv_v=self.cell.ocv_of(soc),
            voltage_v=result.predicted_v,
            innovation_v=result.innovation_v,
            innovation_sigma_v=result.innovation_sigma_v,
            model_valid=check_model(
                state,
                tuning,
                sample.dt_s,
                result.innovation_v,
                sample.noise_v2,
                None if result.all_accepted else result.accepted,
            ),
            accepted=result.accepted,
        )

    def run(
        self, dt_s: FloatArray, current_a: FloatArray, voltage_v: FloatArray, temperature_degc: FloatArray
    ) -> Record:
        """Return the estimates of a whole record, as so many calls of `step` would give them.

        Args:
            dt_s: (n_steps,) time since the previous sample, >= 0 [s].
            current_a: (n_steps,) positive on discharge [A]; NaN = the last one counts.
            voltage_v: (n_steps, n_cells) [V]; NaN where not measured.
            temperature_degc: (n_steps, n_cells) [degC]; NaN = the last one counts.

        Raises:
            ShapeError: the arrays do not fit each other.
            EstimatorError: a step is negative or not finite, or `start` was never called.
        """
        self.require_start()
        check_record(self.n_cells, dt_s, current_a, voltage_v, temperature_degc)
        if self._fast is None:
            return run_steps(self, dt_s, current_a, voltage_v, temperature_degc)
        held = np.array([self.guard.common(0.0, i) for i in current_a])
        return self._fast.record(dt_s, held, voltage_v, temperature_degc)

    def require_start(self) -> None:
        """EstimatorError before `start`."""
        if not self._is_started:
            raise EstimatorError("the filter has not been started")


def wants_numba(engine: Engine) -> bool:
    """Return whether to compile; "auto" does where numba is installed.

    Raises:
        EstimatorError: numba was asked for and is not installed.
    """
    installed = importlib.util.find_spec("numba") is not None
    if engine == "numba" and not installed:
        raise EstimatorError("numba is not installed; it comes with voltwall[fast]")
    return engine == "numba" or (engine == "auto" and installed)


def _fast_step(cell: PackedCell, states: CellStates, rule: SigmaRule | None, tuning: Tuning, fused: bool) -> FastStep:
    from app.estimation.fast import FastStep

    return FastStep(cell, states, rule, tuning, fused)


def soc_variance(state: CellStates, result: StepResult, tuning: Tuning) -> FloatArray:
    """Return (n,) variance of the SOC with the error that averaging does not remove.

    v_f = P_zz + (bias^2 + share * mean square of the innovation) / slope^2: a model that errs is trusted less.
    """
    variance = tuning.bias_share * state.check[1]
    variance += tuning.bias_v**2
    variance /= np.maximum(result.slope_v * result.slope_v, SLOPE_FLOOR_V**2)
    variance += state.cov[SOC, SOC]
    return np.asarray(np.minimum(variance, SOC_VARIANCE_MAX))
