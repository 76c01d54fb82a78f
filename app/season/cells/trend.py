"""A straight line over time with its band of 95 %: what a season says of one quantity of each cell.

    y_k = a + b t_k + e_k,   var e_k proportional to s_k^2 + u^2

s_k is what was measured with it, u what differs from session to session beyond that: by so much the residuals of a line
without weights are larger than the s_k. The line is that of weighted least squares, its band Student's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from app.errors import ExtraMissing
from app.estimation.arrays import FloatArray
from app.words import Message

LEAST: Final = 5  # sessions for a line


@dataclass(frozen=True)
class Line:
    """Values per day and at the last session, `last_day`, with their covariance and the quantile of their band."""

    per_day: float
    now: float
    covariance: FloatArray
    quantile: float
    last_day: float
    n: int

    @property
    def low(self) -> float:
        """Lower end of the band of 95 % of `per_day`."""
        return self.per_day - self.quantile * float(np.sqrt(self.covariance[0, 0]))

    @property
    def high(self) -> float:
        """Upper end of it."""
        return self.per_day + self.quantile * float(np.sqrt(self.covariance[0, 0]))

    @property
    def is_sure(self) -> bool:
        """Whether the band leaves out that nothing changes."""
        return self.low > 0.0 or self.high < 0.0

    def at(self, days: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (n,) values of the line at times, and how far its band of 95 % reaches to either side."""
        design = np.stack((days - self.last_day, np.ones_like(days)), axis=1)
        variance = np.einsum("ni,ij,nj->n", design, self.covariance, design)
        return design @ (self.per_day, self.now), self.quantile * np.sqrt(np.maximum(variance, 0.0))


def line(days: FloatArray, values: FloatArray, sigmas: FloatArray) -> Line | None:
    """Return the line through (n,) values, NaN where there is none; None with fewer than LEAST, or all at once.

    Raises:
        ExtraMissing: SciPy is not installed.
    """
    try:
        from scipy import stats
    except ImportError as error:
        raise ExtraMissing(Message("the-season-lake"), "scipy", "season") from error
    known = np.isfinite(values) & np.isfinite(sigmas)
    days, values, sigmas = days[known], values[known], sigmas[known]
    if len(values) < LEAST or days[-1] <= days[0]:
        return None
    passed, freedom = days - days[-1], len(values) - 2
    residual = values - np.polyval(np.polyfit(passed, values, 1), passed)
    more = max(float(residual @ residual) / freedom - float(np.mean(sigmas**2)), 0.0)
    weights = 1.0 / np.sqrt(sigmas**2 + more + 1e-18)
    (per_day, now), covariance = np.polyfit(passed, values, 1, w=weights, cov=True)
    return Line(
        float(per_day), float(now), covariance, float(stats.t.ppf(0.975, freedom)), float(days[-1]), len(values)
    )


def lines(days: FloatArray, values: FloatArray, sigmas: FloatArray) -> list[Line | None]:
    """Return the line of each column of (n, cells) values."""
    return [line(days, values[:, k], sigmas[:, k]) for k in range(values.shape[1])]
