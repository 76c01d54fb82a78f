"""Lines of the accumulator and of each pack: resistance, capacity, spreads, self-discharge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.season.cells.history import CellHistory, row_median
from app.season.cells.trend import Line, line

MONTH_DAYS: Final = 365.25 / 12
LEAST_SPREAD: Final = 2  # cells
WIDEST: Final = 1.0  # all that there is: a month's band that wide, or that far off, is that of sessions of one day


@dataclass(frozen=True)
class SeasonTrend:
    """A line: per month with the ends of its band of 95 %, and where it is now.

    Attributes:
        tells_month: whether the sessions lie far enough apart to say what a month changes; else only `now` is to be
            told.
    """

    now: float
    per_month: float
    low: float
    high: float
    sessions: int
    is_sure: bool
    tells_month: bool


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


def trend_of(found: Line | None) -> SeasonTrend | None:
    """Return a line per month."""
    if found is None:
        return None
    months = (found.per_day * MONTH_DAYS, found.low * MONTH_DAYS, found.high * MONTH_DAYS)
    return SeasonTrend(found.now, *months, found.n, found.is_sure, tells_month(found))


def tells_month(found: Line) -> bool:
    """Return whether a line says what a month changes: sessions of one day do not."""
    return max(found.high - found.low, found.high, -found.low) * MONTH_DAYS <= WIDEST


def _trend(history: CellHistory, values: FloatArray) -> SeasonTrend | None:
    """Of (n,) values without sigmas: sessions differ by what they differ."""
    return trend_of(line(history.days, values, np.zeros_like(values)))


def _deviation(values: FloatArray) -> FloatArray:
    return _of_known(values, np.std)


def _range(values: FloatArray) -> FloatArray:
    return _of_known(values, np.ptp)


def _of_known(values: FloatArray, reduce: Callable[[FloatArray], float]) -> FloatArray:
    known = [row[np.isfinite(row)] for row in values]
    return np.array([reduce(row) if row.size >= LEAST_SPREAD else np.nan for row in known])
