"""The report of a session: how it went, what limited, what to look at, with the numbers behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from app.analysis.cell_findings import CellJudge
from app.analysis.incidents import is_trigger
from app.analysis.laps.figures import compare_drivers, figures_of
from app.analysis.laps.from_session import LapTable, find_laps
from app.analysis.limits import limits_over_time
from app.analysis.report.findings import (
    CellChange,
    Margin,
    Odd,
    compare_cells,
    headline,
    key_figures,
    odd_cells,
    what_limited,
    what_to_look_at,
)
from app.analysis.report.margins import MarginWatch
from app.analysis.report.over_time import OverTime, over_time
from app.analysis.root_cause.cause import Cause, agreeing
from app.analysis.root_cause.from_session import causes_of
from app.analysis.session_arrays import TotalsCollector
from app.analysis.session_cell import cell_of, judged_by, unlike
from app.analysis.session_survey import survey_session
from app.analysis.survey import Histogram, Piece
from app.analysis.totals import listed
from app.sessions.reading.reader import SessionFile
from app.telemetry.cell_findings import Finding, sensors_of, told_findings
from app.words import Argument, Cell, Message, RenderedMessage, Text, message_or_text, render, sentence
from firmware_protocol.config_image import image_hash

_OF_OTHER_TRIPS = ("master-fault", "bms-fault")  # told beside what caused them


@dataclass(frozen=True)
class ReportedSession:
    """Whose report it is; `started` in unix seconds, `voltwall` is the version that recorded it."""

    id: str
    name: str
    started: float
    voltwall: str
    simulated: bool  # the car was the simulator


@dataclass(frozen=True)
class Findings:
    """What a session shows; `why`: which cell failed, and why."""

    headline: RenderedMessage
    why: list[RenderedMessage]
    limited: list[RenderedMessage]
    look_at: list[RenderedMessage]
    judged: list[RenderedMessage]  # what of then judges it, and what of today


@dataclass(frozen=True)
class Report:
    """How a session went. Lists over cells go by index from 0; None = not measured.

    Attributes:
        session: whose report it is.
        segments: cells of each segment of its battery.
        findings: what is said of it.
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
    findings: Findings
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

    def watched(piece: Piece) -> None:
        judge.add(piece)
        watch.add(piece)

    survey = survey_session(session, watched, collector)
    sensors = sensors_of(session.battery.sensors, session.battery.n_cells)
    found, ended = (told_findings(kind, sensors) for kind in (judge.result(), judge.ended()))
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
    why = [*_cause_findings(causes), *_verdicts(agreeing(found, causes))]
    warnings = [*_ended(ended), *_event_arguments(warned, segments)]
    look_at = what_to_look_at(survey, odd, warnings, session.bad_frames())
    findings = Findings(
        sentence(headline(survey, len(found_laps)), segments),
        [sentence(each, segments) for each in why],
        [sentence(each, segments) for each in what_limited(near, _event_arguments(trips, segments))],
        [sentence(each, segments) for each in look_at],
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
    """Each cause once, with the first thing that speaks for it."""
    by_place: dict[tuple[str, int | None, int | None], Message] = {}
    for cause in causes:
        if cause.code == "unknown":
            continue
        evidence = tuple(each.message for each in cause.evidence)
        same = tuple(each.message for each in cause.same)
        others = tuple(each.message.message for each in cause.others)
        message = Message("report-cause", cause=cause.message.message, evidence=evidence)
        if same:
            message = Message("report-cause-same", cause=cause.message.message, evidence=evidence, causes=same)
        elif others:
            message = Message("report-cause-or", cause=cause.message.message, evidence=evidence, causes=others)
        by_place.setdefault((cause.code, cause.cell, cause.pack), message)
    return list(by_place.values())


def _verdicts(found: Sequence[Finding]) -> list[Message]:
    return [Message("why-finding", finding=each.message, evidence=each.evidence) for each in found]


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


def _ended(found: Sequence[Finding]) -> list[Argument]:
    return [Message("finding-ended", finding=each.message) for each in found]


def _event_arguments(events: Sequence[dict[str, Any]], segments: Sequence[int]) -> list[Argument]:
    """The events with their places, each once."""
    found = [(message_or_text(event["text"], event.get("message")), event["cell"]) for event in events]
    return list({with_cell(message, cell, segments): None for message, cell in found})


def with_cell(event: Text, cell: int | None, segments: Sequence[int]) -> Argument:
    """Return an event's message, with the cell's place where it does not name it."""
    if cell is None or render(Message("at-cell", cell=Cell(cell)), segments) in render(event, segments):
        return event
    return Message("reported-at-cell", event=event, cell=Cell(cell))
