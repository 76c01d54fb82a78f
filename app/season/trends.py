"""Lines of the accumulator and of each pack: resistance, capacity, spreads, self-discharge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.errors import ExtraMissing
from app.estimation.arrays import FloatArray, row_median
from app.season.history import CellHistory
from app.words import Message

LEAST: Final = 5  # sessions for a line


@dataclass(frozen=True)
class RegressionLine:
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
        """Return whether the band leaves out that nothing changes."""
        return self.low > 0.0 or self.high < 0.0

    def at(self, days: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (n,) values of the line at times, and how far its band of 95 % reaches to either side."""
        design = np.stack((days - self.last_day, np.ones_like(days)), axis=1)
        variance = np.einsum("ni,ij,nj->n", design, self.covariance, design)
        return design @ (self.per_day, self.now), self.quantile * np.sqrt(np.maximum(variance, 0.0))


def line(days: FloatArray, values: FloatArray, sigmas: FloatArray) -> RegressionLine | None:
    """Return the line through (n,) values, NaN where there is none; None with fewer than LEAST, or all at once.

    Raises:
        ExtraMissing: SciPy is not installed.
    """
    try:
        from scipy import stats
    except ImportError as error:
        raise ExtraMissing(Message("the-season-lake"), "scipy", "season") from error
    is_finite = np.isfinite(values) & np.isfinite(sigmas)
    days, values, sigmas = days[is_finite], values[is_finite], sigmas[is_finite]
    if len(values) < LEAST or days[-1] <= days[0]:
        return None
    passed, freedom = days - days[-1], len(values) - 2
    residual = values - np.polyval(np.polyfit(passed, values, 1), passed)
    more = max(float(residual @ residual) / freedom - float(np.mean(sigmas**2)), 0.0)
    weights = 1.0 / np.sqrt(sigmas**2 + more + 1e-18)
    (per_day, now), covariance = np.polyfit(passed, values, 1, w=weights, cov=True)
    return RegressionLine(
        float(per_day), float(now), covariance, float(stats.t.ppf(0.975, freedom)), float(days[-1]), len(values)
    )


def lines(days: FloatArray, values: FloatArray, sigmas: FloatArray) -> list[RegressionLine | None]:
    """Return the line of each column of (n, cells) values."""
    return [line(days, values[:, k], sigmas[:, k]) for k in range(values.shape[1])]


MONTH_DAYS: Final = 365.25 / 12
LEAST_SPREAD: Final = 2  # cells
WIDEST: Final = 1.0  # all that there is: a month's band that wide, or that far off, is that of sessions of one day


@dataclass(frozen=True)
class SeasonTrend:
    """A line: per month with the ends of its band of 95 %, and where it is now.

    Attributes:
        is_reportable: whether the sessions lie far enough apart to give the change a month; else only `now` counts.
    """

    now: float
    per_month: float
    low: float
    high: float
    sessions: int
    is_sure: bool
    is_reportable: bool


@dataclass(frozen=True)
class SeasonGroup:
    """The accumulator, or one pack of it; None where a quantity was measured too seldom.

    Attributes:
        pack: from 0; None: the accumulator.
        resistance: of the median cell, a fraction of new; where no session was estimated against the median cell of the
            accumulator.
        capacity: of the median cell, a fraction of new.
        spread: of resistance between cells, standard deviation, a fraction of the median cell's.
        soc_spread: SOC of the highest cell less that of the lowest, at the first rest of a session.
        self_discharge: SOC a day that the median cell lost between two sessions; of a pack beyond the accumulator's
            median cell.
    """

    pack: int | None
    resistance: SeasonTrend | None
    capacity: SeasonTrend | None
    spread: SeasonTrend | None
    soc_spread: SeasonTrend | None
    self_discharge: SeasonTrend | None


def groups_of(history: CellHistory, segments: Sequence[int]) -> list[SeasonGroup]:
    """Return the accumulator, then each pack, where there is more than one; `segments` are numbers of cells."""
    resistance, _ = history.of("resistance")
    capacity, _ = history.of("capacity")
    relative = resistance / row_median(resistance)[:, None]
    lost = history.today(history.lost_per_day)
    soc = history.today(history.rest_soc)
    nothing = np.full(len(history.sessions), np.nan)
    whole = (
        row_median(resistance) if history.is_absolute else nothing,
        row_median(capacity),
        _deviation(relative),
        _range(soc),
        row_median(lost),
    )
    made = [SeasonGroup(None, *(_trend(history, values) for values in whole))]
    if len(segments) < 2:
        return made
    ends = np.cumsum(segments)
    packs = [slice(int(end) - cells, int(end)) for end, cells in zip(ends, segments, strict=True)]
    beyond = lost - row_median(lost)[:, None]
    of_pack = (
        (resistance, row_median),
        (capacity, row_median),
        (relative, _deviation),
        (soc, _range),
        (beyond, row_median),
    )
    return made + [
        SeasonGroup(k, *(_trend(history, reduce(values[:, pack])) for values, reduce in of_pack))
        for k, pack in enumerate(packs)
    ]


def trend_of(regression: RegressionLine | None) -> SeasonTrend | None:
    """Return a line per month."""
    if regression is None:
        return None
    months = (regression.per_day * MONTH_DAYS, regression.low * MONTH_DAYS, regression.high * MONTH_DAYS)
    return SeasonTrend(regression.now, *months, regression.n, regression.is_sure, is_reportable(regression))


def is_reportable(regression: RegressionLine) -> bool:
    """Return whether a line says what a month changes: sessions of one day do not."""
    return max(regression.high - regression.low, regression.high, -regression.low) * MONTH_DAYS <= WIDEST


def _trend(history: CellHistory, values: FloatArray) -> SeasonTrend | None:
    """Of (n,) values without sigmas: sessions differ by what they differ."""
    return trend_of(line(history.days, values, np.zeros_like(values)))


def _deviation(values: FloatArray) -> FloatArray:
    return _of_known(values, np.std)


def _range(values: FloatArray) -> FloatArray:
    return _of_known(values, np.ptp)


def _of_known(values: FloatArray, reduce: Callable[[FloatArray], float]) -> FloatArray:
    finite = [row[np.isfinite(row)] for row in values]
    return np.array([reduce(row) if row.size >= LEAST_SPREAD else np.nan for row in finite])
