"""The product's default: a sigma-point filter that starts from voltage alone, fused with a charge count.

The filter knows nothing of the SOC that was handed over, so the two are independent witnesses. While they agree
the fusion is their precision-weighted mean: what a filter with the right prior would say. When they contradict
each other the start was wrong, and the filter rules; a count that stays contradicted is anchored anew.

    w  = P(start was right | both)      from N(d; 0, v_f + v_c) against "anywhere in 0..1"
    z  = z_f - w g d,  g = v_f / (v_f + v_c),  d = z_f - z_c
    s2 = w v_f v_c / (v_f + v_c) + (1 - w) v_f + w (1 - w) g^2 d^2
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.estimation.circuit import CellModel
from app.estimation.coulomb import ChargeCount, moved_soc, start_count
from app.estimation.errors import EstimatorError
from app.estimation.estimates import Estimates
from app.estimation.filters import GaussianEstimator, per_cell, soc_variance
from app.estimation.marginal import SOC
from app.estimation.sigma_points import SigmaRule
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]


@dataclass
class Fusion:
    """The count of n cells and for how long it has been contradicted."""

    count: ChargeCount
    doubt_s: FloatArray

    def combine(
        self, tuning: Tuning, dt_s: float, filter_soc: FloatArray, filter_v2: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return (n,) fused SOC and variance; anchors the count anew where it has been contradicted too long.

        Args:
            tuning: probabilities and times.
            dt_s: step [s].
            filter_soc: (n,) SOC of the filter.
            filter_v2: (n,) variance of it, model error included.
        """
        count = self.count
        count_v2 = count.variance(tuning)
        total = filter_v2 + count_v2
        d = filter_soc - count.soc
        prior = math.log((1.0 - tuning.start_unknown) / tuning.start_unknown) - 0.5 * math.log(2.0 * math.pi)
        odds = prior - 0.5 * (np.log(total) + d * d / total)
        w = 1.0 / (1.0 + np.exp(np.minimum(-odds, 500.0)))
        g = filter_v2 / total
        wgd = w * g * d
        soc = filter_soc - wgd
        variance = filter_v2 * (1.0 - w * g) + (1.0 - w) * g * d * wgd
        self.doubt_s = np.where(w < 0.5, self.doubt_s + dt_s, np.maximum(self.doubt_s - dt_s, 0.0))
        if self.doubt_s.max() > tuning.anchor_s:
            self._anchor(self.doubt_s > tuning.anchor_s, filter_soc, filter_v2)
        return soc, variance

    def _anchor(self, where: NDArray[np.bool_], soc: FloatArray, variance: FloatArray) -> None:
        count = self.count
        count.soc = np.where(where, soc, count.soc)
        count.anchor_soc = np.where(where, soc, count.anchor_soc)
        count.anchor_v2 = np.where(where, variance, count.anchor_v2)
        count.since_s = np.where(where, 0.0, count.since_s)
        self.doubt_s = np.where(where, 0.0, self.doubt_s)


class FusedEstimator:
    """A filter and a charge count over n_cells cells, fused at every step."""

    def __init__(self, model: CellModel, n_cells: int, rule: SigmaRule | None, tuning: Tuning) -> None:
        self.model = model
        self.tuning = tuning
        self._filter = GaussianEstimator(model, n_cells, rule, tuning)
        self._fusion: Fusion | None = None

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self._filter.n_cells

    @property
    def state_mean(self) -> FloatArray:
        """(n_states, n_cells) of the filter: SOC, then RC currents [A]; a copy."""
        return self._filter.state_mean

    @property
    def state_cov(self) -> FloatArray:
        """(n_cells, n_states, n_states) of the filter; a copy."""
        return self._filter.state_cov

    @property
    def counted_soc(self) -> FloatArray:
        """(n_cells,) SOC of the charge count; a copy."""
        return self._started().count.soc.copy()

    def start(
        self,
        voltages_v: ArrayLike,
        temperatures_degc: ArrayLike,
        current_a: float,
        soc: ArrayLike | None = None,
        soc_sigma: ArrayLike | None = None,
    ) -> None:
        """Start the filter from the voltage and the count from `soc`; see `CellEstimator.start`."""
        inner, n = self._filter, self.n_cells
        inner.start(voltages_v, temperatures_degc, current_a)
        step = inner.guard.check(0.0, current_a, voltages_v, temperatures_degc)
        given = per_cell("soc", np.nan if soc is None else soc, n)
        sigma = per_cell("soc_sigma", self.tuning.counter_soc_sigma if soc_sigma is None else soc_sigma, n)
        self._fusion = Fusion(start_count(inner.cell, self.tuning, step, given, sigma), np.zeros(n))

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> Estimates:
        """Return the estimates after one sample; see `CellEstimator.step`."""
        fusion, inner = self._started(), self._filter
        state = inner.started()
        sample = inner.guard.check(dt_s, current_a, voltages_v, temperatures_degc)
        inner.filter.predict(state, sample)
        result = inner.filter.update(state, sample)
        fusion.count.move(moved_soc(self.model, sample.current_a, sample.dt_s), sample.dt_s)
        filter_v2 = soc_variance(state, result, self.tuning)
        soc, variance = fusion.combine(self.tuning, sample.dt_s, state.mean[SOC], filter_v2)
        j, f = inner.cell.place_soc(soc)
        return replace(
            inner.report(sample, result),
            soc=np.minimum(np.maximum(soc, 0.0), 1.0),
            soc_sigma=np.sqrt(variance),
            ocv_v=inner.cell.ocv_at(j, f),
        )

    def _started(self) -> Fusion:
        if self._fusion is None:
            raise EstimatorError("the filter has not been started")
        return self._fusion
