"""The life of every cell across sessions: capacity, resistance, self-discharge, balancing, rank, and where it drifts.

A cell is judged against its peers, so that temperature and the season do not count: resistance and capacity relative
to the median, self-discharge beyond the median. A swapped module begins a new line and inherits nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from app.analysis.finding import AnalysisFinding, json_args
from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.health.capacity import SOC_MOVED_MIN, CapacityTracker
from app.words import Message, Quantity, render

DAY_S: Final = 86_400.0
WEEK_DAYS: Final = 7.0
REST_GAP_S: Final = 8 * 3600.0  # a shorter pause tells nothing of self-discharge
REST_MOVED_MAX: Final = 0.03  # the median cell moved by more: the pack was used or charged unrecorded
DRIFT_SESSIONS: Final = 4
DRIFT_SPAN_DAYS: Final = 5.0
DRIFT_SIGMAS: Final = 3.0
WEEKS_AHEAD: Final = 12.0
CAPACITY_LOW: Final = -0.05  # against the median cell
RESISTANCE_HIGH: Final = 0.2
SELF_DISCHARGE_HIGH: Final = 0.002  # SOC a day beyond the median: 0.2 %
MAD_TO_SIGMA: Final = 1.4826


@dataclass(frozen=True)
class Stretch:
    """Charge counted between two rests: (n_cells,) change of SOC, its sigma, charge and its sigma [Ah]."""

    soc_moved: FloatArray
    soc_moved_sigma: float
    charge_ah: float
    charge_sigma_ah: float


@dataclass(frozen=True)
class SessionRecord:
    """What one session told; arrays are (n_cells,), NaN where it told nothing."""

    session_id: str
    start_s: float  # unix
    end_s: float
    resistance_ohm: FloatArray
    balancing_s: FloatArray
    first_rest_s: float | None
    first_rest_v: FloatArray
    last_rest_s: float | None
    last_rest_v: FloatArray
    stretches: tuple[Stretch, ...]
    nominal_ah: float | None = None  # by the cell file of then, like the charge; None: it is not kept
    first_rest_soc: FloatArray | None = None
    last_rest_soc: FloatArray | None = None


@dataclass(frozen=True)
class Swap:
    """Modules that were replaced at an instant."""

    time_s: float
    cells: tuple[int, ...]
    note: str = ""
    car: str | None = None  # None: of every car

    def is_of(self, car: str) -> bool:
        """Whether it counts for a car."""
        return self.car in (None, car)


DriftKind = Literal["capacity", "resistance", "self-discharge"]


@dataclass(frozen=True)
class Drift(AnalysisFinding):
    """A cell that moves away from the others; `weeks` until its limit, 0: it is passed."""

    cell: int
    what: DriftKind
    per_week: float  # fraction of the median; self-discharge: SOC a day, now
    now: float
    limit: float
    weeks: float


@dataclass(frozen=True)
class Passports:
    """(n_sessions, n_cells) histories, NaN where not known, and what they say of every cell now.

    Attributes:
        sessions: ids, the oldest first.
        times_s: (n_sessions,) unix time of their starts.
        line: (n_sessions, n_cells) number of the line that a session belongs to, 0 before any swap.
        line_now: (n_cells,) the line that the next session will belong to.
        capacity_ah: after each session.
        resistance_ohm: in each session; resistance_relative against its median.
        self_discharge_per_day: SOC a day beyond the median, over all pauses so far.
        balancing_h: hours bled so far.
        rank: (n_cells,) 1 = soundest; NaN of a cell that nothing was measured of.
        drifts: the nearest to its limit first.
        n_by_todays_cell: sessions that keep no cell file: today's judges them.
    """

    sessions: tuple[str, ...]
    times_s: FloatArray
    line: FloatArray
    line_now: FloatArray
    capacity_ah: FloatArray
    capacity_sigma_ah: FloatArray
    resistance_ohm: FloatArray
    resistance_relative: FloatArray
    self_discharge_per_day: FloatArray
    balancing_h: FloatArray
    rank: FloatArray
    drifts: tuple[Drift, ...]
    n_by_todays_cell: int = 0

    def now(self, name: str) -> FloatArray:
        """Return (n_cells,) the newest of a history; NaN of a module of which there is no session yet."""
        return latest(getattr(self, name), self.line, self.line_now)


def passports(
    records: Sequence[SessionRecord],
    swaps: Sequence[Swap],
    nominal_ah: float,
    soc_at: Callable[[FloatArray], FloatArray],
    n_cells: int,
) -> Passports:
    """Return the life of every cell.

    Args:
        records: of sessions, in any order.
        swaps: of modules, in any order.
        nominal_ah: capacity of a new cell, where a record does not say [Ah].
        soc_at: SOC of rested cells by their voltage [V], likewise.
        n_cells: number of cells.
    """
    ordered = sorted(records, key=lambda record: record.start_s)
    shape = (len(ordered), n_cells)
    line, capacity, sigma, self_rate, bled = (np.full(shape, np.nan) for _ in range(5))
    nominal_ah = _nominal(ordered[0], nominal_ah) if ordered else nominal_ah
    tracker = CapacityTracker(nominal_ah, n_cells)
    observed, lines = np.zeros(n_cells, dtype=bool), np.zeros(n_cells)
    hours, lost, days = np.zeros(n_cells), np.zeros(n_cells), np.zeros(n_cells)
    pending = sorted(swaps, key=lambda swap: swap.time_s)
    before: SessionRecord | None = None
    for k, record in enumerate(ordered):
        swapped = np.zeros(n_cells, dtype=bool)
        while pending and pending[0].time_s <= record.start_s:
            swapped[list(pending.pop(0).cells)] = True
        if swapped.any():
            tracker = _renewed(tracker, swapped, _nominal(record, nominal_ah))
            observed[swapped] = False
            lines[swapped] += 1
            for sums in (hours, lost, days):
                sums[swapped] = 0.0
        if before is not None and (apart := _self_discharge(before, record, soc_at)) is not None:
            known = np.isfinite(apart[0]) & ~swapped
            lost[known] += apart[0][known]
            days[known] += apart[1]
        for stretch in record.stretches:
            tracker.observe(stretch.soc_moved, stretch.soc_moved_sigma, stretch.charge_ah, stretch.charge_sigma_ah)
            observed |= np.abs(np.nan_to_num(stretch.soc_moved)) >= SOC_MOVED_MIN
        hours += np.nan_to_num(record.balancing_s) / 3600.0
        capacity[k], sigma[k] = (
            np.where(observed, each, np.nan) for each in (tracker.capacity_ah(), tracker.sigma_ah())
        )
        line[k], bled[k] = lines, hours
        self_rate[k] = np.where(days > 0.0, lost / np.maximum(days, 1e-9), np.nan)
        before = record
    for swap in pending:
        lines[list(swap.cells)] += 1
    times_s = np.array([record.start_s for record in ordered])
    resistance = np.array([record.resistance_ohm for record in ordered]).reshape(shape)
    relative = resistance / _row_median(resistance) - 1.0
    made = Passports(
        tuple(record.session_id for record in ordered),
        times_s,
        line,
        lines,
        capacity,
        sigma,
        resistance,
        relative,
        self_rate,
        bled,
        _rank(*(latest(values, line, lines) for values in (capacity, relative, self_rate))),
        (),
        sum(record.nominal_ah is None for record in ordered),
    )
    return Passports(**{**vars(made), "drifts": tuple(_drifts(made))})


def _renewed(tracker: CapacityTracker, swapped: BoolArray, nominal_ah: float) -> CapacityTracker:
    n_cells = len(swapped)
    state = tracker.state
    state[:, swapped] = CapacityTracker(nominal_ah, n_cells).state[:, swapped]
    return CapacityTracker(tracker.nominal_ah, n_cells, state)


def _nominal(record: SessionRecord, otherwise_ah: float) -> float:
    return otherwise_ah if record.nominal_ah is None else record.nominal_ah


def _self_discharge(
    before: SessionRecord, after: SessionRecord, soc_at: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, float] | None:
    """Charge lost beyond the median cell between two rests, and the days between them."""
    if before.last_rest_s is None or after.first_rest_s is None:
        return None
    last = soc_at(before.last_rest_v) if before.last_rest_soc is None else before.last_rest_soc
    first = soc_at(after.first_rest_v) if after.first_rest_soc is None else after.first_rest_soc
    gap_s = after.first_rest_s - before.last_rest_s
    lost = lost_in_pause(last, first, gap_s)
    return None if lost is None else (lost - float(np.nanmedian(lost)), gap_s / DAY_S)


def lost_in_pause(last_soc: FloatArray, first_soc: FloatArray, gap_s: float) -> FloatArray | None:
    """Return (n_cells,) SOC lost in a pause; None where it is too short, or the pack was used or charged meanwhile.

    Args:
        last_soc: (n_cells,) at the rest before it.
        first_soc: (n_cells,) at the rest after it.
        gap_s: from one rest to the other.
    """
    lost = last_soc - first_soc
    known = lost[np.isfinite(lost)]
    if not gap_s >= REST_GAP_S or not known.size or abs(float(np.median(known))) > REST_MOVED_MAX:
        return None
    return lost


def _row_median(values: FloatArray) -> FloatArray:
    medians = np.full((len(values), 1), np.nan)
    for k, row in enumerate(values):
        known = row[np.isfinite(row)]
        if known.size and np.median(known) > 0.0:  # without a resistance there is nothing to compare with
            medians[k] = np.median(known)
    return medians


def latest(values: FloatArray, line: FloatArray, line_now: FloatArray) -> FloatArray:
    """Return (n_cells,) the newest known value of every cell within its present line."""
    found = np.full(values.shape[1], np.nan)
    for k in range(len(values)):
        fresh = np.isfinite(values[k]) & (line[k] == line_now)
        found[fresh] = values[k][fresh]
    return found


def _rank(capacity: FloatArray, relative: FloatArray, self_rate: FloatArray) -> FloatArray:
    """1 = soundest: little resistance, much capacity, little self-discharge, each in robust standard deviations."""
    badness, judged = np.zeros(len(capacity)), np.zeros(len(capacity), dtype=bool)
    for values, sign in ((capacity, -1.0), (relative, 1.0), (self_rate, 1.0)):
        known = values[np.isfinite(values)]
        if known.size > 2:
            median = float(np.median(known))
            sigma = MAD_TO_SIGMA * float(np.median(np.abs(known - median)))
            if sigma > 0.0:
                badness += sign * np.nan_to_num((values - median) / sigma)
                judged |= np.isfinite(values)
    cells = np.flatnonzero(judged)
    rank = np.full(len(capacity), np.nan)
    rank[cells[np.argsort(badness[cells], kind="stable")]] = np.arange(1, len(cells) + 1)
    return rank


def _drifts(made: Passports) -> list[Drift]:
    if not made.sessions:
        return []
    found: list[Drift | None] = []
    capacity_relative = made.capacity_ah / _row_median(made.capacity_ah) - 1.0
    for cell in range(made.rank.size):
        inside = made.line[:, cell] == made.line_now[cell]
        days = made.times_s[inside] / DAY_S
        found += [
            _trend(cell, "capacity", days, capacity_relative[inside, cell], CAPACITY_LOW),
            _trend(cell, "resistance", days, made.resistance_relative[inside, cell], RESISTANCE_HIGH),
        ]
    rates = made.now("self_discharge_per_day")
    for cell in np.flatnonzero(np.nan_to_num(rates) > SELF_DISCHARGE_HIGH).tolist():
        rate = float(rates[cell])
        message = Message("drift-self-discharge", rate=_percent(rate, 2))
        found.append(_drift(message, cell, "self-discharge", rate, rate, SELF_DISCHARGE_HIGH, 0.0))
    return sorted((drift for drift in found if drift is not None), key=lambda drift: drift.weeks)


def _trend(cell: int, what: DriftKind, days: FloatArray, values: FloatArray, limit: float) -> Drift | None:
    """A straight line through a cell's relative values; None where it is flat, uncertain, or far from the limit."""
    known = np.isfinite(values)
    days, values = days[known], values[known]
    if not days.size:
        return None
    now, sign = float(np.median(values[-3:])), np.sign(limit)
    if days.size >= DRIFT_SESSIONS and days[-1] - days[0] >= DRIFT_SPAN_DAYS:
        t = days - days.mean()
        spread = float(t @ t)
        slope = float(t @ (values - values.mean())) / spread
        residual = values - values.mean() - slope * t
        sigma = float(np.sqrt(residual @ residual / max(days.size - 2, 1) / spread))
        fitted = float(values.mean() + slope * t[-1])
        if sign * slope > DRIFT_SIGMAS * sigma and sign * slope > 0.0:
            weeks = max((limit - fitted) / slope / WEEK_DAYS, 0.0)
            if weeks <= WEEKS_AHEAD:
                message = _approach(what, slope * WEEK_DAYS, fitted, limit, weeks)
                return _drift(message, cell, what, slope * WEEK_DAYS, fitted, limit, weeks)
    if sign * now >= sign * limit:
        amount, allowed = _percent(now, 1), _percent(limit, 0)
        message = (
            Message("drift-capacity-beyond", now=amount, limit=allowed)
            if what == "capacity"
            else Message("drift-resistance-beyond", now=amount, limit=allowed)
        )
        return _drift(message, cell, what, 0.0, now, limit, 0.0)
    return None


def _approach(what: DriftKind, per_week: float, now: float, limit: float, weeks: float) -> Message:
    """How fast a cell comes to its limit."""
    pace, amount, allowed = _percent(per_week, 2), _percent(now, 1), _percent(limit, 0)
    n = max(round(weeks), 1)
    if what == "capacity":
        if weeks == 0.0:
            return Message("drift-capacity-passed", pace=pace, now=amount, limit=allowed)
        return Message("drift-capacity", pace=pace, now=amount, limit=allowed, n=n)
    if weeks == 0.0:
        return Message("drift-resistance-passed", pace=pace, now=amount, limit=allowed)
    return Message("drift-resistance", pace=pace, now=amount, limit=allowed, n=n)


def _drift(
    message: Message, cell: int, what: DriftKind, per_week: float, now: float, limit: float, weeks: float
) -> Drift:
    return Drift(message.code, json_args(message), render(message), cell, what, per_week, now, limit, weeks)


def _percent(fraction: float, digits: int) -> Quantity:
    return Quantity(100 * abs(fraction), "%", digits)
