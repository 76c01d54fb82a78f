"""How much more every cell resists than its cell file says: a regression of measured on modelled drops.

    y = v_ocv - v,   x = (v_ocv - v_model) / f_used;   y = f x + error, both without what is slower than `DRIFT_S`
    m' = m + (1 - exp(-dt / DRIFT_S)) (y - m)                             of y and x, the slow part of each
    s' = exp(-dt / MEMORY_S) s + dt (x x, x y, y y)                       of what is left of them
    e  = 2 LASTING_S (s_yy - s_xy^2 / s_xx) / seconds
    f  = (s_xy / e + w f_0) / (s_xx / e + w),   sigma = (s_xx / e + w)^-1/2,   w = 1 / sigma_0^2

All resistances of a cell are taken to grow alike. What is slow is SOC, heat and overpotential and tells nothing. The
model's error is not white and lasts about `LASTING_S`, so closer samples repeat each other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.filters.estimates import OUT_OCV, OUT_VOLTAGE

DRIFT_S: Final = 40.0
MEMORY_S: Final = 300.0  # four or five laps; heat changes resistances, and the model follows heat only in part
LASTING_S: Final = 6.0  # time of an error from which the drift has been taken
RESTART_S: Final = 2.0  # a hole this long begins the drift anew
FACTOR_MIN, FACTOR_MAX = 0.2, 10.0  # beyond it, it is no resistance
QUIET_V: Final = 2e-3  # where no cell's drop moves more, nothing can be learnt and nothing is forgotten
DROP_MAX_V: Final = 1.5  # a larger difference of voltages is a measurement that failed
ERROR_MIN_V2: Final = 1e-6


@dataclass(frozen=True)
class Regression:
    """What is kept of the drops: slow (2, n) parts of y and x [V], (3, n) sums [V^2 s], (n,) each of the rest."""

    slow: FloatArray
    has_slow: BoolArray
    sums: FloatArray
    weight_s: FloatArray

    def step(self, dt_s: float, drops: FloatArray) -> Regression:
        """Return what is kept after the (2, n) drops of one sample; NaN = missing."""
        is_known = (np.abs(drops) < DROP_MAX_V).all(axis=0)
        had_slow = self.has_slow & (dt_s <= RESTART_S)
        slow = np.where(is_known & ~had_slow, drops, self.slow)
        left = np.where(is_known, drops - slow, 0.0)
        slow += (1.0 - exp(-dt_s / DRIFT_S)) * left
        fresh = replace(self, slow=slow, has_slow=had_slow | is_known)
        y, x = left
        if float(np.abs(x).max()) < QUIET_V:
            return fresh
        fade = exp(-dt_s / MEMORY_S)
        sums = fade * self.sums + dt_s * np.array((x * x, x * y, y * y))
        return replace(fresh, sums=sums, weight_s=fade * self.weight_s + dt_s * is_known)

    def judge(self, prior: FloatArray, prior_weight: FloatArray) -> FloatArray:
        """Return (2, n) factor and sigma, with what was believed beforehand and one over its variance."""
        xx, xy, yy = self.sums
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.where(self.weight_s > 0.0, np.where(xx > 0.0, yy - xy * xy / xx, yy) / self.weight_s, 0.0)
        error_v2s = 2.0 * LASTING_S * np.maximum(left, ERROR_MIN_V2)
        precision = xx / error_v2s + prior_weight
        factor = (xy / error_v2s + prior_weight * prior) / precision
        return np.array((np.clip(factor, FACTOR_MIN, FACTOR_MAX), precision**-0.5))


class ReferenceResistance:
    """The regression over n_cells cells, from a prior factor and one over its variance, (n_cells,) each."""

    def __init__(self, prior: FloatArray, prior_weight: FloatArray) -> None:
        n = prior.size
        self._prior = prior, prior_weight
        self._kept = Regression(np.zeros((2, n)), np.zeros(n, np.bool_), np.zeros((3, n)), np.zeros(n))

    def record(self, dt_s: FloatArray, numbers: FloatArray, factor: FloatArray, voltage_v: FloatArray) -> None:
        """Take n_steps samples in a row.

        Args:
            dt_s: (n_steps,) since the sample before [s].
            numbers: (n_steps, 8, n_cells) what a filter said of them, as in `Estimates`.
            factor: (n_cells,) resistances over those of the cell file it was said with.
            voltage_v: (n_steps, n_cells) measured [V]; NaN = missing.
        """
        for dt, said, volts in zip(dt_s.tolist(), numbers, voltage_v, strict=True):
            drops = np.array((said[OUT_OCV] - volts, (said[OUT_OCV] - said[OUT_VOLTAGE]) / factor))
            self._kept = self._kept.step(dt, drops)

    def judge(self) -> FloatArray:
        """Return (2, n_cells) factor and its standard deviation."""
        return self._kept.judge(*self._prior)
