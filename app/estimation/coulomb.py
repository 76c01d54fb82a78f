"""Charge counting: the estimate that never learns and never jumps, with a sigma that says so."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.estimation.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.errors import EstimatorError
from app.estimation.estimates import Estimates
from app.estimation.filters import per_cell, start_state
from app.estimation.inputs import InputGuard
from app.estimation.marginal import SOC, StepInput
from app.estimation.self_check import SelfCheck
from app.estimation.tables import BRANCH, OVERPOTENTIAL, R0, PackedCell
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]


@dataclass
class ChargeCount:
    """SOC by counting from an anchor, for n cells.

    sigma^2 = sigma_anchor^2 + (gain d)^2 + (offset t)^2, with d the SOC moved and t the time since the anchor:
    gain and offset of a sensor are constants, so their errors add up in line, not in square.

    Attributes:
        soc: (n,) counted SOC.
        anchor_soc: (n,) SOC at the anchor.
        anchor_v2: (n,) its variance.
        since_s: (n,) time since the anchor [s].
    """

    soc: FloatArray
    anchor_soc: FloatArray
    anchor_v2: FloatArray
    since_s: FloatArray

    def move(self, moved_soc: float, dt_s: float) -> None:
        """Take a share of the capacity out of every cell."""
        self.soc -= moved_soc
        self.since_s += dt_s

    def variance(self, tuning: Tuning) -> FloatArray:
        """Return (n,) variance of the counted SOC."""
        gain = tuning.counter_gain * (self.anchor_soc - self.soc)
        offset = (tuning.counter_offset_c / SECONDS_PER_HOUR) * self.since_s
        return np.asarray(self.anchor_v2 + gain * gain + offset * offset)


def moved_soc(model: CellModel, current_a: float, dt_s: float) -> float:
    """Return the share of the capacity that a held current takes out; charging counts times the efficiency."""
    kept = model.coulombic_efficiency if current_a < 0 else 1.0
    return kept * current_a * dt_s / (SECONDS_PER_HOUR * model.capacity_ah)


def start_count(cell: PackedCell, tuning: Tuning, step: StepInput, soc: FloatArray, sigma: FloatArray) -> ChargeCount:
    """Return a count that starts at the given SOC, or where it is NaN at what the voltage says."""
    state = start_state(cell, tuning, step)
    known = ~np.isnan(soc)
    first = np.where(known, soc, state.mean[SOC])
    variance = np.where(known, sigma * sigma, state.cov[SOC, SOC])
    return ChargeCount(first.copy(), first, variance, np.zeros_like(first))


class CoulombCounter:
    """Counts charge; predicts voltages open loop so that its residuals can be compared with a filter's."""

    def __init__(self, model: CellModel, n_cells: int, tuning: Tuning) -> None:
        self.model = model
        self.tuning = tuning
        self.cell = PackedCell(model)
        self.guard = InputGuard(self.cell, n_cells, tuning)
        self._n_cells = n_cells
        self._count: ChargeCount | None = None
        self._branch = np.zeros((model.n_rc, n_cells))
        self._hysteresis = np.zeros(n_cells)
        self._check = SelfCheck(n_cells, tuning)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self._n_cells

    @property
    def state_mean(self) -> FloatArray:
        """(n_states, n_cells) SOC, then RC currents [A]; a copy."""
        return np.concatenate((self._started().soc[None], self._branch))

    @property
    def state_cov(self) -> FloatArray:
        """(n_cells, n_states, n_states) covariance; the RC currents are taken as known."""
        d = 1 + self.model.n_rc
        cov = np.zeros((self._n_cells, d, d))
        cov[:, SOC, SOC] = self._started().variance(self.tuning)
        return cov

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
        given = per_cell("soc", np.nan if soc is None else soc, self._n_cells)
        sigma = per_cell("soc_sigma", self.tuning.counter_soc_sigma if soc_sigma is None else soc_sigma, self._n_cells)
        self._count = start_count(self.cell, self.tuning, step, given, sigma)
        self._branch[:] = 0.0
        self._hysteresis[:] = 0.0
        self._check = SelfCheck(self._n_cells, self.tuning)

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> Estimates:
        """Return the estimates after one sample; see `CellEstimator.step`."""
        count, model, cell = self._started(), self.model, self.cell
        step = self.guard.check(dt_s, current_a, voltages_v, temperatures_degc)
        i = step.current_a
        moved = moved_soc(model, i, step.dt_s)
        j, f = cell.place_soc(count.soc)
        decay = np.exp(-step.dt_s / cell.tau_at(j, f, step.row, step.row_weight))
        self._branch = decay * self._branch + (1.0 - decay) * i
        count.move(moved, step.dt_s)
        follow = np.exp(-model.hysteresis_rate * abs(moved))
        self._hysteresis = follow * self._hysteresis - (1.0 - follow) * np.sign(moved)
        j, f = cell.place_soc(count.soc)
        c = cell.circuit_at(j, f, step.row, step.row_weight)
        ocv = cell.ocv_at(j, f)
        over = np.arcsinh(i / model.overpotential_current_a)
        drop = i * c[R0] + over * c[OVERPOTENTIAL] + (c[BRANCH:] * self._branch).sum(axis=0)
        predicted = ocv - drop + model.hysteresis_v * self._hysteresis
        innovation = step.voltage_v - predicted
        return Estimates(
            soc=np.clip(count.soc, 0.0, 1.0),
            soc_sigma=np.minimum(np.sqrt(count.variance(self.tuning)), 0.5),
            ocv_v=ocv,
            voltage_v=predicted,
            innovation_v=innovation,
            innovation_sigma_v=np.sqrt(step.noise_v2 * step.noise_scale + self.tuning.sensor_v**2),
            model_valid=self._check.step(step.dt_s, innovation, step.noise_v2),
            accepted=np.zeros(self._n_cells, dtype=np.bool_),
        )

    def _started(self) -> ChargeCount:
        if self._count is None:
            raise EstimatorError("the counter has not been started")
        return self._count
