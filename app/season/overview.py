"""A season as it is shown: trends of the accumulator and its cells, steps, which cell limits soonest and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.analysis.finding import AnalysisFinding, finding
from app.analysis.passport.history import CAPACITY_LOW, RESISTANCE_HIGH, SELF_DISCHARGE_HIGH
from app.analysis.totals import listed, number
from app.estimation.arrays import FloatArray
from app.season.cells.ageing import ageing
from app.season.cells.history import DAY_S, CellHistory, newest_median, row_median
from app.season.cells.trend import Line, Step, lines, steps
from app.season.trends import (
    MONTH_DAYS,
    SeasonGroup,
    SeasonStep,
    SeasonTrend,
    groups_of,
    step_of,
    tells_month,
    trend_of,
)
from app.words import Message, Quantity

AHEAD_DAYS: Final = 90.0
CURVE_POINTS: Final = 40
TOLD: Final = 0.25  # of a limit: below, a cell gives no reason
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
    resistance_step: SeasonStep | None
    capacity_step: SeasonStep | None
    reasons: list[AnalysisFinding]


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
    """A quantity of one cell: what was measured, and the band of 95 % of the Gaussian process, also ahead."""

    time_s: list[float]
    measured: list[float | None]
    sigma: list[float | None]
    curve_time_s: list[float]
    mean: list[float | None]
    low: list[float | None]
    high: list[float | None]


def overview_of(history: CellHistory, segments: Sequence[int]) -> SeasonOverview:
    """Return what a season says; `segments` are numbers of cells of the packs."""
    resistance, r_sigma = history.of("resistance")
    capacity, c_sigma = history.of("capacity")
    relative, c_relative = (values / row_median(values)[:, None] for values in (resistance, capacity))
    lost = history.today(history.lost_per_day)
    lost = lost - row_median(lost)[:, None]
    r_lines, c_lines, l_lines = (
        lines(history.days, values, sigmas)
        for values, sigmas in ((relative, r_sigma), (c_relative, c_sigma), (lost, history.lost_sigma))
    )
    none: list[Step | None] = [None] * history.n_cells
    r_steps, c_steps = (
        steps(history.days, values, sigmas) if len(history.sessions) else none
        for values, sigmas in ((relative, r_sigma), (c_relative, c_sigma))
    )
    r_now, c_now = newest_median(relative, NEWEST) - 1.0, _against(newest_median(capacity, NEWEST))
    leak = history.self_discharge_per_day
    made = [
        _rank(
            cell,
            (r_now[cell], c_now[cell], leak[cell]),
            (r_lines[cell], c_lines[cell], l_lines[cell]),
            (step_of(r_steps[cell], history), step_of(c_steps[cell], history)),
        )
        for cell in range(history.n_cells)
    ]
    return SeasonOverview(
        history.car,
        len(history.sessions),
        history.is_absolute,
        float(history.charge_ah[-1]) if len(history.charge_ah) else 0.0,
        groups_of(history, segments),
        sorted(made, key=lambda each: (-each.score, each.cell)),
    )


def curve_of(history: CellHistory, cell: int, name: str) -> SeasonCurve:
    """Return `resistance` or `capacity` of a cell, a fraction of new, up to AHEAD_DAYS ahead at the same use."""
    values, sigmas = history.of(name)
    if not len(history.sessions):
        return SeasonCurve([], [], [], [], [], [], [])
    days, charge = history.days, history.charge_ah
    asked = np.linspace(0.0, days[-1] + AHEAD_DAYS, CURVE_POINTS)
    pace = charge[-1] / days[-1] if days[-1] > 0.0 else 0.0
    found = ageing(
        days,
        charge,
        values,
        sigmas,
        asked,
        np.where(asked <= days[-1], np.interp(asked, days, charge), charge[-1] + pace * (asked - days[-1])),
    )
    start_s = float(history.start_s[0])
    return SeasonCurve(
        history.start_s.tolist(),
        listed(values[:, cell], 6),
        listed(sigmas[:, cell], 6),
        (start_s + asked * DAY_S).tolist(),
        listed(found.mean[:, cell], 6),
        listed(found.low[:, cell], 6),
        listed(found.high[:, cell], 6),
    )


def _rank(
    cell: int,
    now: tuple[float, float, float],
    found: tuple[Line | None, Line | None, Line | None],
    stepped: tuple[SeasonStep | None, SeasonStep | None],
) -> CellRank:
    (resistance, capacity, leak), (r_step, c_step) = now, stepped
    r_line, c_line, l_line = (each if each is not None and tells_month(each) else None for each in found)
    shares = (resistance / RESISTANCE_HIGH, capacity / CAPACITY_LOW, leak / SELF_DISCHARGE_HIGH)
    messages: list[Message] = []
    if shares[0] >= TOLD:
        messages.append(Message("season-resists", now=_percent(resistance)))
    if shares[1] >= TOLD:
        messages.append(Message("season-holds-less", now=_percent(-capacity)))
    if shares[2] >= TOLD:
        messages.append(Message("season-leaks", rate=_percent(leak, 2)))
    if r_line is not None and r_line.low > 0.0 and r_line.per_day * SOON_DAYS >= TOLD * RESISTANCE_HIGH:
        low, high, pace = (_percent(value * MONTH_DAYS, 2) for value in (r_line.low, r_line.high, r_line.per_day))
        messages.append(Message("season-resistance-grows", pace=pace, low=low, high=high))
    if c_line is not None and c_line.high < 0.0 and c_line.per_day * SOON_DAYS <= TOLD * CAPACITY_LOW:
        low, high, pace = (_percent(-value * MONTH_DAYS, 2) for value in (c_line.high, c_line.low, c_line.per_day))
        messages.append(Message("season-capacity-falls", pace=pace, low=low, high=high))
    if l_line is not None and l_line.low > 0.0 and l_line.per_day * SOON_DAYS >= TOLD * SELF_DISCHARGE_HIGH:
        low, high, pace = (_percent(value * MONTH_DAYS, 3) for value in (l_line.low, l_line.high, l_line.per_day))
        messages.append(Message("season-leak-grows", pace=pace, low=low, high=high))
    if r_step is not None:
        messages.append(Message("season-step", size=_percent(r_step.size), session=r_step.session))
    if c_step is not None:
        messages.append(Message("season-capacity-step", size=_percent(c_step.size), session=c_step.session))
    return CellRank(
        cell,
        float(np.fmax.reduce([0.0, *shares])),
        number(resistance),
        number(capacity),
        number(leak),
        trend_of(found[0]),
        trend_of(found[1]),
        trend_of(found[2]),
        r_step,
        c_step,
        [finding(message) for message in messages],
    )


def _percent(fraction: float, digits: int = 1) -> Quantity:
    return Quantity(100.0 * float(fraction), "%", digits)


def _against(values: FloatArray) -> FloatArray:
    known = values[np.isfinite(values)]
    return values / np.median(known) - 1.0 if known.size else values
