"""Charge counting: the estimate that never learns and never jumps, with a sigma that says so."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.estimation.filters.estimates import Estimates
from app.estimation.filters.fusion import count_variance
from app.estimation.filters.inputs import InputGuard
from app.estimation.filters.own_cells import OwnCapacity, use_resistance
from app.estimation.filters.process import Process
from app.estimation.filters.record import Record, check_record, run_steps
from app.estimation.filters.self_check import SelfCheck
from app.estimation.filters.start import initial_soc_sigma, per_cell, start_count, start_from_voltage
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning

SIGMA_MAX = 0.5


class CoulombCounter:
    """Counts charge; predicts voltages open loop so that its residuals can be compared with a filter's."""

    def __init__(self, model: CellModel, n_cells: int, tuning: Tuning) -> None:
        self.model = model
        self.tuning = tuning
        self.cell = PackedCell(model)
        self.states = CellStates(model.n_rc, n_cells)
        self.guard = InputGuard(self.cell, self.states, tuning)
        self._capacity = OwnCapacity(model, self.states)
        self._process = Process(self.cell, self.states, tuning, counts=True)
        self._check = SelfCheck(self.states, tuning)
        self._is_started = False

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.states.n_cells

    @property
    def state_mean(self) -> FloatArray:
        """(n_states, n_cells) SOC, then RC currents [A]; a copy."""
        return self.states.mean.copy()

    @property
    def state_cov(self) -> FloatArray:
        """(n_cells, n_states, n_states) covariance; the RC currents are as good as the model says."""
        cov = np.moveaxis(self.states.cov, 2, 0).copy()
        cov[:, SOC, :] = cov[:, :, SOC] = 0.0
        cov[:, SOC, SOC] = count_variance(self.states.drift, self.states.anchor_v2)
        return cov

    def voltage_soc(self) -> None:
        """Return None: a charge count uses no voltage."""
        return

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
        given = per_cell("soc", soc, np.nan, self.n_cells)
        sigma = per_cell("soc_sigma", soc_sigma, np.nan, self.n_cells)
        sample = self.guard.check(0.0, current_a, voltages_v, temperatures_degc)
        start_from_voltage(self.cell, self.states, self.tuning, sample)
        start_count(self.states, given, initial_soc_sigma(self.cell, self.states, self.tuning, sample, given, sigma))
        self.states.mean[SOC] = self.states.count_soc
        self._is_started = True

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> Estimates:
        """Return the estimates after one sample; see `CellEstimator.step`."""
        if not self._is_started:
            raise EstimatorError("the counter has not been started")
        state, model, cell = self.states, self.model, self.cell
        step = self.guard.check(dt_s, current_a, voltages_v, temperatures_degc)
        i = step.current_a
        self._capacity.take(i, step.dt_s)
        self._process.predict(step)
        state.mean[SOC] = state.count_soc
        j, f = cell.place_soc(state.count_soc)
        c = cell.circuit_at(j, f, step.climate.row, step.climate.row_weight)
        ocv = cell.ocv_at(j, f)
        predicted = ocv - state.resistance * cell.drop(c, i, state.mean[1:]) + model.hysteresis_v * state.hysteresis
        innovation = step.voltage_v - predicted
        valid = self._check.update(step.dt_s, innovation, step.noise_v2, ~np.isnan(innovation))
        soc, sigma = (
            np.clip(state.count_soc, 0.0, 1.0),
            np.minimum(np.sqrt(count_variance(state.drift, state.anchor_v2)), SIGMA_MAX),
        )
        expected = np.sqrt(step.noise_v2 * step.climate.noise_scale)
        return Estimates(np.array([soc, sigma, ocv, predicted, innovation, expected, valid, np.zeros(self.n_cells)]))

    def run(
        self, dt_s: FloatArray, current_a: FloatArray, voltage_v: FloatArray, temperature_degc: FloatArray
    ) -> Record:
        """Return the estimates of a whole record; see `GaussianEstimator.run`."""
        check_record(self.n_cells, dt_s, current_a, voltage_v, temperature_degc)
        return run_steps(self, dt_s, current_a, voltage_v, temperature_degc)
