"""A season as it is shown: trends of the accumulator and its cells, which cell limits soonest and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.analysis.totals import listed, number
from app.estimation.arrays import FloatArray, row_median
from app.season.history import DAY_S, CellHistory, newest_median
from app.season.trends import (
    MONTH_DAYS,
    RegressionLine,
    SeasonGroup,
    SeasonTrend,
    groups_of,
    is_reportable,
    line,
    lines,
    trend_of,
)
from app.words import Message, Quantity, RenderedMessage, sentence

CAPACITY_LOW: Final = -0.05  # against the median cell
RESISTANCE_HIGH: Final = 0.2
SELF_DISCHARGE_HIGH: Final = 0.002  # SOC a day beyond the median: 0.2 %
LINE_POINTS: Final = 20  # points of a curve: the ends of its band bend
REASON_SHARE: Final = 0.25  # share of a limit below which a cell gives no reason
SOON_DAYS: Final = 182.6  # a pace is a reason where it goes so much of the way within half a year
NEWEST: Final = 3  # sessions that say how a cell is now


@dataclass(frozen=True)
class CellRank:
    """One cell against the median one; `score` is how far it has gone to the nearest limit: 1 is there."""

    cell: int
    score: float
    resistance: float | None
    capacity: float | None
    self_discharge_per_day: float | None
    resistance_trend: SeasonTrend | None
    capacity_trend: SeasonTrend | None
    self_discharge_trend: SeasonTrend | None
    reasons: list[RenderedMessage]


@dataclass(frozen=True)
class SeasonOverview:
    """The accumulator of a car, its packs, and all cells, the one that limits soonest first."""

    car: str
    sessions: int
    is_absolute: bool
    charge_ah: float
    groups: list[SeasonGroup]  # the accumulator, then each pack
    cells: list[CellRank]


@dataclass(frozen=True)
class SeasonCurve:
    """A quantity of a cell: what was measured of any module, and the line of today's with its band of 95 %."""

    time_s: list[float]
    measured: list[float | None]
    sigma: list[float | None]
    line_time_s: list[float]  # empty, like the others, with too few measurements
    line: list[float]
    low: list[float]
    high: list[float]


def overview_of(history: CellHistory, segments: Sequence[int]) -> SeasonOverview:
    """Return what a season says; `segments` are numbers of cells of the packs."""
    resistance, r_sigma = history.of("resistance")
    capacity, c_sigma = history.of("capacity")
    relative, c_relative = (values / row_median(values)[:, None] for values in (resistance, capacity))
    lost, l_sigma = history.of("self_discharge")
    r_lines, c_lines, l_lines = (
        lines(history.days, values, sigmas)
        for values, sigmas in ((relative, r_sigma), (c_relative, c_sigma), (lost, l_sigma))
    )
    r_now, c_now = newest_median(relative, NEWEST) - 1.0, _against(newest_median(capacity, NEWEST))
    leak = history.self_discharge_per_day
    made = [
        _rank(
            cell,
            (r_now[cell], c_now[cell], leak[cell]),
            (r_lines[cell], c_lines[cell], l_lines[cell]),
        )
        for cell in range(history.n_cells)
    ]
    return SeasonOverview(
        history.car,
        len(history.sessions),
        history.is_absolute,
        float(history.charge_ah[-1]) if len(history.charge_ah) else 0.0,
        groups_of(history, segments),
        sorted(made, key=lambda rank: (-rank.score, rank.cell)),
    )


def curve_of(history: CellHistory, cell: int, name: str) -> SeasonCurve:
    """Return a quantity of a cell as `CellHistory.measured` names it, with its line from first to last measurement."""
    measured, measured_sigma = (listed(series[:, cell], 6) for series in history.measured(name))
    start_s: list[float] = history.start_s.tolist()
    values, sigmas = (series[:, cell] for series in history.of(name))
    fitted = line(history.days, values, sigmas)
    if fitted is None:
        return SeasonCurve(start_s, measured, measured_sigma, [], [], [], [])
    asked = np.linspace(history.days[np.isfinite(values)][0], fitted.last_day, LINE_POINTS)
    drawn, reach = fitted.at(asked)
    drawn_s, low, high = start_s[0] + asked * DAY_S, drawn - reach, drawn + reach
    return SeasonCurve(start_s, measured, measured_sigma, drawn_s.tolist(), drawn.tolist(), low.tolist(), high.tolist())


def _rank(
    cell: int,
    now: tuple[float, float, float],
    lines: tuple[RegressionLine | None, RegressionLine | None, RegressionLine | None],
) -> CellRank:
    resistance, capacity, leak = now
    r_line, c_line, l_line = (fitted if fitted is not None and is_reportable(fitted) else None for fitted in lines)
    shares = (resistance / RESISTANCE_HIGH, capacity / CAPACITY_LOW, leak / SELF_DISCHARGE_HIGH)
    messages: list[Message] = []
    if shares[0] >= REASON_SHARE:
        messages.append(Message("season-resists", now=_percent(resistance)))
    if shares[1] >= REASON_SHARE:
        messages.append(Message("season-holds-less", now=_percent(-capacity)))
    if shares[2] >= REASON_SHARE:
        messages.append(Message("season-leaks", rate=_percent(leak, 2)))
    if r_line is not None and r_line.low > 0.0 and r_line.per_day * SOON_DAYS >= REASON_SHARE * RESISTANCE_HIGH:
        low, high, pace = (_percent(value * MONTH_DAYS, 2) for value in (r_line.low, r_line.high, r_line.per_day))
        messages.append(Message("season-resistance-grows", pace=pace, low=low, high=high))
    if c_line is not None and c_line.high < 0.0 and c_line.per_day * SOON_DAYS <= REASON_SHARE * CAPACITY_LOW:
        low, high, pace = (_percent(-value * MONTH_DAYS, 2) for value in (c_line.high, c_line.low, c_line.per_day))
        messages.append(Message("season-capacity-falls", pace=pace, low=low, high=high))
    if l_line is not None and l_line.low > 0.0 and l_line.per_day * SOON_DAYS >= REASON_SHARE * SELF_DISCHARGE_HIGH:
        low, high, pace = (_percent(value * MONTH_DAYS, 3) for value in (l_line.low, l_line.high, l_line.per_day))
        messages.append(Message("season-leak-grows", pace=pace, low=low, high=high))
    return CellRank(
        cell,
        float(np.fmax.reduce([0.0, *shares])),
        number(resistance),
        number(capacity),
        number(leak),
        trend_of(lines[0]),
        trend_of(lines[1]),
        trend_of(lines[2]),
        [sentence(message) for message in messages],
    )


def _percent(fraction: float, digits: int = 1) -> Quantity:
    return Quantity(100.0 * float(fraction), "%", digits)


def _against(values: FloatArray) -> FloatArray:
    finite = values[np.isfinite(values)]
    return values / np.median(finite) - 1.0 if finite.size else values
