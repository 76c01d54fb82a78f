"""The filters behind one interface: EKF, UKF, CDKF, and the fusion of one of them with a charge count."""

from __future__ import annotations

import importlib.util
import logging
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.estimation.filters.compiled.engine import FastStep
from app.estimation.filters.estimates import N_OUT, Estimates
from app.estimation.filters.fusion import Fusion
from app.estimation.filters.inputs import InputGuard
from app.estimation.filters.marginal import MarginalFilter
from app.estimation.filters.own_cells import OwnCapacity, use_resistance
from app.estimation.filters.process import SOC_VARIANCE_MAX, Process
from app.estimation.filters.record import Record, check_record, run_steps
from app.estimation.filters.self_check import SelfCheck
from app.estimation.filters.sigma_points import SigmaRule
from app.estimation.filters.start import (
    SLOPE_FLOOR_V,
    impose_soc,
    initial_soc_sigma,
    per_cell,
    start_count,
    start_from_voltage,
)
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning

Engine = Literal["auto", "numpy", "numba"]

logger = logging.getLogger(__name__)
NOT_STARTED: Final = "the filter has not been started"
BLOCK_STEPS: Final = 64  # of a record: what a block needs fits a processor's cache
ZERO: Final = np.array(0.0)
ONE: Final = np.array(1.0)
SLOPE_FLOOR_V2: Final = np.array(SLOPE_FLOOR_V * SLOPE_FLOOR_V)
VARIANCE_MAX: Final = np.array(SOC_VARIANCE_MAX)


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
        self._capacity = OwnCapacity(model, self.states)
        self._process = Process(self.cell, self.states, tuning, counts=fused)
        self._fusion = Fusion(self.states, tuning) if fused else None
        self._check = SelfCheck(self.states, tuning)
        self._filter = MarginalFilter(self.cell, self.states, rule, tuning)
        self._fast: FastStep | None = None
        if wants_numba(engine):
            try:
                self._fast = FastStep(self.cell, self.states, rule, tuning, fused)
            except EstimatorError as error:
                if engine == "numba":
                    raise
                logger.warning("estimating with numpy alone: %s", error)
        self._soc, self._filter_v2 = self.states.mean[SOC], self.states.cov[SOC, SOC]
        self._numbers = np.empty((N_OUT, n_cells))
        self._rows = tuple(self._numbers)
        self._bias_v2 = np.array(tuning.bias_v * tuning.bias_v)
        self._is_started = False
        self._was_given_soc = False  # a SOC, which a filter without a count goes on from

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

    def voltage_soc(self) -> tuple[FloatArray, FloatArray] | None:
        """Return what voltages alone say; see `CellEstimator.voltage_soc`."""
        if self._was_given_soc:
            return None
        soc = self.states.mean[SOC].copy()
        slope_v = np.maximum(self.model.ocv.slope(np.clip(soc, 0.0, 1.0)), SLOPE_FLOOR_V)
        variance = self.states.cov[SOC, SOC] + (self.tuning.bias_v**2 + self.states.bias_v2) / slope_v**2
        return soc, np.sqrt(np.minimum(variance, SOC_VARIANCE_MAX))

    def use_capacity(self, capacity_ah: ArrayLike) -> None:
        """Count with capacities of the cells' own; see `CellEstimator.use_capacity`."""
        self._capacity.use(capacity_ah)

    def use_resistance(self, factor: ArrayLike) -> None:
        """Foretell voltages with resistances of the cells' own; see `CellEstimator.use_resistance`."""
        use_resistance(self.states, factor)

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
        sigma = per_cell("soc_sigma", soc_sigma, np.nan if self.fused else tuning.start_soc_sigma, n)
        sample = self.guard.check(0.0, current_a, voltages_v, temperatures_degc)
        start_from_voltage(self.cell, self.states, tuning, sample)
        self._was_given_soc = not self.fused and bool(np.isfinite(given).any())
        if self.fused:
            start_count(self.states, given, initial_soc_sigma(self.cell, self.states, tuning, sample, given, sigma))
        else:
            impose_soc(self.states, given, sigma)
        self._is_started = True

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> Estimates:
        """Return the estimates after one sample; see `CellEstimator.step`."""
        if not self._is_started:
            raise EstimatorError(NOT_STARTED)
        fast = self._fast
        if fast is not None:
            held_a = self.guard.common(dt_s, current_a)
            if self._capacity.is_used:
                self._capacity.take(held_a, dt_s)
            return fast.step(dt_s, held_a, voltages_v, temperatures_degc)
        sample = self.guard.check(dt_s, current_a, voltages_v, temperatures_degc)
        reported, sigma, ocv, predicted, innovation, innovation_sigma, valid, accepted = self._rows
        if self._capacity.is_used:
            self._capacity.take(sample.current_a, sample.dt_s)
        self._process.predict(sample)
        used = self._filter.update(sample, predicted, innovation, innovation_sigma)
        slope_v = self._filter.ocv_slope_v
        soc, variance = self._soc, soc_variance(self._bias_v2, self._filter_v2, self.states.bias_v2, slope_v)
        if self._fusion is not None:
            soc, variance = self._fusion.fuse(sample.dt_s, soc, variance)
        if used is None:
            accepted.fill(1.0)
        else:
            accepted[:] = used
        valid[...] = self._check.update(sample.dt_s, innovation, sample.noise_v2, used)
        np.maximum(soc, ZERO, out=reported)
        np.minimum(reported, ONE, out=reported)
        np.sqrt(variance, sigma)
        ocv[...] = self.cell.ocv_of(soc)
        return Estimates(self._numbers.copy())

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
        if not self._is_started:
            raise EstimatorError(NOT_STARTED)
        check_record(self.n_cells, dt_s, current_a, voltage_v, temperature_degc)
        if self._fast is None:
            return self._in_blocks(dt_s, current_a, voltage_v, temperature_degc)
        if self._capacity.is_used:
            return run_steps(self, dt_s, current_a, voltage_v, temperature_degc)
        held = np.array([self.guard.common(0.0, i) for i in current_a])
        return self._fast.record(dt_s, held, voltage_v, temperature_degc)

    def _in_blocks(
        self, dt_s: FloatArray, current_a: FloatArray, voltage_v: FloatArray, temperature_degc: FloatArray
    ) -> Record:
        """Return what `step` would: only what feeds back goes sample by sample, the rest by the block."""
        steps, n = voltage_v.shape
        numbers = np.empty((N_OUT, steps, n))
        for begin in range(0, steps, BLOCK_STEPS):
            part = slice(begin, begin + BLOCK_STEPS)
            self._block(dt_s[part], current_a[part], voltage_v[part], temperature_degc[part], numbers[:, part])
        return Record(numbers)

    def _block(
        self,
        dt_s: FloatArray,
        current_a: FloatArray,
        voltage_v: FloatArray,
        temperature_degc: FloatArray,
        numbers: FloatArray,
    ) -> None:
        reported, sigma, ocv, predicted, innovation, innovation_sigma, valid, accepted = numbers
        states, steps, times_s = self.states, dt_s.size, dt_s.tolist()
        soc, filter_v2, slope_v = np.empty((3, *voltage_v.shape))
        counts, before = np.empty((steps, *states.count.shape)), states.count.copy()
        noise_v2 = np.empty(steps)
        accepted[:] = 1.0
        all_accepted = True
        for k, (dt, current) in enumerate(zip(times_s, current_a.tolist(), strict=True)):
            sample = self.guard.check(dt, current, voltage_v[k], temperature_degc[k])
            if self._capacity.is_used:
                self._capacity.take(sample.current_a, dt)
            self._process.predict(sample)
            used = self._filter.update(sample, predicted[k], innovation[k], innovation_sigma[k])
            soc[k], filter_v2[k], slope_v[k] = self._soc, self._filter_v2, self._filter.ocv_slope_v
            counts[k] = states.count
            noise_v2[k] = sample.noise_v2
            if used is not None:
                all_accepted = False
                accepted[k] = used
        counting = None if all_accepted else accepted != 0.0
        valid[:], bias_v2 = self._check.update_block(times_s, innovation, noise_v2, counting)
        variance = soc_variance(self._bias_v2, filter_v2, bias_v2, slope_v)
        if self._fusion is not None:
            soc, variance = self._fusion.fuse_block(times_s, soc, variance, counts, before)
        np.clip(soc, 0.0, 1.0, out=reported)
        np.sqrt(variance, sigma)
        ocv[:] = self.cell.ocv_of(soc)


def soc_variance(model_v2: FloatArray, filter_v2: FloatArray, bias_v2: FloatArray, slope_v: FloatArray) -> FloatArray:
    """Return (...) variance of the SOC with the error that averaging does not remove.

    v_f = P_zz + (bias^2 + mean square of the lasting innovation) / slope^2: a model that errs is trusted less.

    Args:
        model_v2: () what the model errs by in any case [V^2].
        filter_v2: (...) variance of the filter's SOC.
        bias_v2: (...) mean square of the lasting innovation before the sample [V^2].
        slope_v: (...) dOCV/dSOC [V].
    """
    slope_v2 = slope_v * slope_v
    np.maximum(slope_v2, SLOPE_FLOOR_V2, out=slope_v2)
    variance: FloatArray = np.add(bias_v2, model_v2)
    np.divide(variance, slope_v2, variance)
    np.add(variance, filter_v2, variance)
    np.minimum(variance, VARIANCE_MAX, out=variance)
    return variance


def wants_numba(engine: Engine) -> bool:
    """Return whether to compile; "auto" does where numba is installed.

    Raises:
        EstimatorError: numba was asked for and is not installed.
    """
    installed = importlib.util.find_spec("numba") is not None
    if engine == "numba" and not installed:
        raise EstimatorError("numba is not installed; it comes with voltwall[fast]")
    return engine == "numba" or (engine == "auto" and installed)
