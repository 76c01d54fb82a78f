"""The report of a session: how it went, what limited, what to look at, with the numbers behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from app.analysis.incidents import is_trigger
from app.analysis.laps.figures import compare_drivers, figures_of
from app.analysis.laps.from_session import LapTable, find_laps
from app.analysis.limits import LimitsOverTime, MovingLimit, limits_over_time
from app.analysis.report.over_time import OverTime, over_time
from app.analysis.report.summary import (
    LOWEST_ALLOWED,
    NEAR,
    CellChange,
    LimitName,
    Margin,
    Odd,
    compare_cells,
    headline,
    key_figures,
    margin_of,
    margins,
    odd_cells,
    recommended_checks,
    what_limited,
)
from app.analysis.root_cause.from_session import causes_of
from app.analysis.root_cause.judge import UNEXPLAINED, Cause, trip_cause
from app.analysis.session_cell import cell_of, judged_by, unlike
from app.analysis.session_judge import CellJudge
from app.analysis.session_survey import TotalsCollector, survey_session
from app.analysis.survey import Histogram, Survey, SurveyPiece, keep_extreme
from app.analysis.totals import listed
from app.sessions.reading.reader import SessionFile
from app.telemetry.cell_findings import Finding, agreeing, findings_in_words, sensors_of
from app.words import Argument, Cell, Message, RenderedMessage, Text, message_or_text, render, sentence
from firmware_protocol.config_image import image_hash

_NAMES: Final[dict[str, LimitName]] = {
    "v_cell_min": "v_min",
    "v_cell_max": "v_max",
    "t_cell_max": "t_max",
    "i_disc_max": "i_max",
    "i_disc_min": "i_min",
}


class MarginWatch:
    """Takes a recording piece by piece, in order; `add` can be the `also` of `survey_session`."""

    def __init__(self, n_cells: int, limits: LimitsOverTime) -> None:
        """Judge by the limits in force; the first set since ever, those that signals carry moment by moment."""
        self._since_s = [since_s for since_s, _ in limits.in_force[1:]]
        self._limits = [values for _, values in limits.in_force] or [{}]
        self._moving = limits.moving
        self._nearest: dict[LimitName, Margin] = {}  # to those that signals carry
        self._spans = [_empty(n_cells) for _ in self._limits]

    def add(self, piece: SurveyPiece) -> None:
        """Take the next piece."""
        edges = [0, *np.searchsorted(piece.time_s, self._since_s).tolist(), len(piece.time_s)]
        for span, first, last in zip(self._spans, edges[:-1], edges[1:], strict=True):
            if last > first:
                _keep(span, piece, slice(first, last))
        for name, moving in self._moving.items():
            if name in _NAMES:
                self._keep_nearest(_nearest_to(moving, _NAMES[name], piece))

    def _keep_nearest(self, margin: Margin | None) -> None:
        if margin is not None:
            before = self._nearest.get(margin.limit)
            if before is None or margin.margin < before.margin:
                self._nearest[margin.limit] = margin

    def nearest(self) -> list[Margin]:
        """Return how near every known limit came, each by its nearest stretch, the nearest first."""
        nearest = dict(self._nearest)
        for span, limits in zip(self._spans, self._limits, strict=True):
            for margin in margins(span, limits):
                if margin.limit not in nearest or margin.margin < nearest[margin.limit].margin:
                    nearest[margin.limit] = margin
        return sorted(nearest.values(), key=lambda margin: margin.margin / NEAR[margin.limit])


def _nearest_to(moving: MovingLimit, limit: LimitName, piece: SurveyPiece) -> Margin | None:
    """How near a piece came to a limit that moves: the instant at which the value was nearest, not the extreme."""
    allowed = moving.at(piece.time_s)
    tables = {"v_min": piece.voltage_v, "v_max": piece.voltage_v, "t_max": piece.temperature_degc}
    values = tables.get(limit, piece.current_a[:, None])
    left = values - allowed[:, None] if limit in LOWEST_ALLOWED else allowed[:, None] - values
    if not np.isfinite(left).any():
        return None
    row, column = np.unravel_index(np.nanargmin(left), left.shape)
    cell = int(column) if limit in tables else None
    return margin_of(limit, float(values[row, column]), float(allowed[row]), cell, float(piece.time_s[row]))


def _empty(n_cells: int) -> Survey:
    nan = np.full(n_cells, np.nan)
    return Survey(
        n_cells,
        voltage_min_v=nan.copy(),
        voltage_min_at_s=nan.copy(),
        voltage_max_v=nan.copy(),
        temperature_max_degc=nan.copy(),
        temperature_max_at_s=nan.copy(),
    )


def _keep(span: Survey, piece: SurveyPiece, rows: slice) -> None:
    time_s, volts, degc = piece.time_s[rows], piece.voltage_v[rows], piece.temperature_degc[rows]
    keep_extreme(span.voltage_min_v, span.voltage_min_at_s, volts, time_s, lowest=True)
    keep_extreme(span.temperature_max_degc, span.temperature_max_at_s, degc, time_s, lowest=False)
    span.voltage_max_v = np.fmax(span.voltage_max_v, np.fmax.reduce(volts, axis=0))
    current = np.nan_to_num(piece.current_a[rows])
    span.current_max_a = max(span.current_max_a, float(current.max()))
    span.current_min_a = min(span.current_min_a, float(current.min()))


_OF_OTHER_TRIPS = ("master-fault", "bms-fault")  # listed with what caused them


@dataclass(frozen=True)
class ReportedSession:
    """The session of a report; `started` in unix seconds, `voltwall` is the version that recorded it."""

    id: str
    name: str
    started: float
    voltwall: str
    simulated: bool  # the car was the simulator


@dataclass(frozen=True)
class ReportSummary:
    """The findings of a session, as codes with arguments; `why`: which cell failed, and why."""

    headline: RenderedMessage
    why: list[RenderedMessage]
    limited: list[RenderedMessage]
    recommended_checks: list[RenderedMessage]
    judged: list[RenderedMessage]  # what of then judges it, and what of today


@dataclass(frozen=True)
class Report:
    """The report of a session. Lists over cells go by index from 0; None = not measured.

    Attributes:
        session: whose report it is.
        segments: cells of each pack of its battery.
        findings: the same as codes.
        causes: of each trip, then of what is wrong without one; the first is the main one.
        margins: how near each limit came, the nearest first.
        odd: the cells that are unlike the others.
        figures: what two sessions are compared by; the unit is in the name.
        histograms: of current, temperature and soc.
        over_time: the accumulator from start to end.
        laps: with their figures.
        limits: of the configuration in force at the end, by name, in units; `margins` go by those of their time.
        config_hash: of that configuration, None where none was received.
        resistance_ohm, voltage_min_v, temperature_max_degc, balancing_s: of every cell.
    """

    session: ReportedSession
    segments: list[int]
    findings: ReportSummary
    causes: list[Cause]
    margins: list[Margin]
    odd: list[Odd]
    figures: dict[str, float | None]
    histograms: dict[str, Histogram]
    over_time: OverTime
    laps: LapTable
    limits: dict[str, float]
    config_hash: str | None
    resistance_ohm: list[float | None]
    voltage_min_v: list[float | None]
    temperature_max_degc: list[float | None]
    balancing_s: list[float | None]


@dataclass(frozen=True)
class ComparedSession:
    """One of two sessions; `started` in unix seconds, `judged`: what of then judges it."""

    id: str
    name: str
    started: float
    figures: dict[str, float | None]
    histograms: dict[str, Histogram]
    judged: list[RenderedMessage]


@dataclass(frozen=True)
class SessionComparison:
    """Two sessions side by side; `cells` changed the most in resistance, `unlike`: what of then differs."""

    a: ComparedSession
    b: ComparedSession
    cells: list[CellChange]
    unlike: list[RenderedMessage]


def report_of(session: SessionFile) -> Report:
    """Read a session and judge it."""
    info, collector = session.info, TotalsCollector(session.battery.n_cells)
    cell, _ = cell_of(session)
    judge, configs = CellJudge(cell, session.battery.segments), session.configs()
    limits_then = limits_over_time(session)
    watch = MarginWatch(session.battery.n_cells, limits_then)

    def watched(piece: SurveyPiece) -> None:
        judge.add(piece)
        watch.add(piece)

    survey = survey_session(session, watched, collector)
    sensors = sensors_of(session.battery.sensors, session.battery.n_cells)
    current, ended = (findings_in_words(kind, sensors) for kind in (judge.result(), judge.ended()))
    totals = collector.totals()
    source, found_laps = find_laps(session, totals, None, None)
    laps = [figures_of(lap, totals) for lap in found_laps]
    image = configs[-1].image if configs else None
    limits, events = limits_then.at(), session.events()
    near, odd = watch.nearest(), odd_cells(survey)
    trips = [event for event in events if event["severity"] == "trip" and event["code"] not in _OF_OTHER_TRIPS]
    warned = [event for event in events if event["severity"] == "warning" and is_trigger("warning", event["code"])]
    causes = causes_of(session, cell)
    segments = session.battery.segments
    why = [*_cause_findings(causes), *_verdicts(agreeing(current, [trip_cause(cause) for cause in causes]))]
    warnings = [*_ended(ended), *_event_arguments(warned, segments)]
    checks = recommended_checks(survey, odd, warnings, session.bad_frames())
    findings = ReportSummary(
        sentence(headline(survey, sum(not lap.is_partial for lap in found_laps)), segments),
        [sentence(message, segments) for message in why],
        [sentence(message, segments) for message in what_limited(near, _event_arguments(trips, segments))],
        [sentence(check, segments) for check in checks],
        judged_by(session),
    )
    return Report(
        session=ReportedSession(
            info.id,
            info.name,
            info.started_wall_ns / 1e9,
            info.voltwall,
            info.metadata.get("source") == "simulator",
        ),
        segments=list(segments),
        findings=findings,
        causes=causes,
        margins=near,
        odd=odd,
        figures=key_figures(survey),
        histograms=survey.histograms,
        over_time=over_time(totals),
        laps=LapTable(source, laps, compare_drivers(laps)),
        limits=limits,
        config_hash=None if image is None else image_hash(image),
        resistance_ohm=listed(survey.resistance_ohm),
        voltage_min_v=listed(survey.voltage_min_v),
        temperature_max_degc=listed(survey.temperature_max_degc),
        balancing_s=listed(survey.balancing_s),
    )


def _cause_findings(causes: Sequence[Cause]) -> list[Message]:
    """Each cause once, with its first evidence."""
    by_place: dict[tuple[str, int | None, int | None], Message] = {}
    for cause in causes:
        if cause.code == UNEXPLAINED:
            continue
        evidence = tuple(evidence.message for evidence in cause.evidence)
        same = tuple(same.message for same in cause.same)
        others = tuple(other.message.message for other in cause.others)
        message = Message("report-cause", cause=cause.message.message, evidence=evidence)
        if same:
            message = Message("report-cause-same", cause=cause.message.message, evidence=evidence, causes=same)
        elif others:
            message = Message("report-cause-or", cause=cause.message.message, evidence=evidence, causes=others)
        by_place.setdefault((cause.code, cause.cell, cause.pack), message)
    return list(by_place.values())


def _verdicts(findings: Sequence[Finding]) -> list[Message]:
    return [Message("why-finding", finding=finding.message, evidence=finding.evidence) for finding in findings]


def compare_sessions(first: SessionFile, second: SessionFile) -> SessionComparison:
    """Read two sessions and lay them side by side."""
    surveys = survey_session(first), survey_session(second)
    is_same_shape = first.battery.segments == second.battery.segments
    a, b = (
        _compared(session, key_figures(survey), survey.histograms)
        for session, survey in zip((first, second), surveys, strict=True)
    )
    return SessionComparison(a, b, compare_cells(*surveys) if is_same_shape else [], unlike(first, second))


def _compared(
    session: SessionFile, figures: dict[str, float | None], histograms: dict[str, Histogram]
) -> ComparedSession:
    info = session.info
    return ComparedSession(info.id, info.name, info.started_wall_ns / 1e9, figures, histograms, judged_by(session))


def _ended(findings: Sequence[Finding]) -> list[Argument]:
    return [Message("finding-ended", finding=finding.message) for finding in findings]


def _event_arguments(events: Sequence[dict[str, Any]], segments: Sequence[int]) -> list[Argument]:
    """The events with their places, each once."""
    messages = [(message_or_text(event["text"], event.get("message")), event["cell"]) for event in events]
    return list({with_cell(message, cell, segments): None for message, cell in messages})


def with_cell(event: Text, cell: int | None, segments: Sequence[int]) -> Argument:
    """Return an event's message, with the cell's place where it does not name it."""
    if cell is None or render(Message("at-cell", cell=Cell(cell)), segments) in render(event, segments):
        return event
    return Message("reported-at-cell", event=event, cell=Cell(cell))
