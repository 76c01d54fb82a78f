"""The report of a session: how it went, what limited, what to look at, with the numbers behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from app.analysis.black_box.excerpt import is_trigger, place
from app.analysis.black_box.from_session import limits_of
from app.analysis.laps.figures import compare_drivers, figures_of
from app.analysis.laps.from_session import LapTable, find_laps
from app.analysis.report.findings import (
    Margin,
    Odd,
    compare_cells,
    headline,
    key_figures,
    margins,
    odd_cells,
    what_limited,
    what_to_look_at,
)
from app.analysis.report.verdict import verdicts
from app.analysis.session_arrays import TotalsCollector
from app.analysis.session_survey import survey_session
from app.analysis.survey import Histogram, Survey
from app.analysis.totals import Totals
from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile
from firmware_protocol.config_image import image_hash


@dataclass(frozen=True)
class Report:
    """All that the report's page shows."""

    info: SessionInfo
    headline: str
    why: list[str]
    limited: list[str]
    look_at: list[str]
    margins: list[Margin]
    odd: list[Odd]
    figures: dict[str, float | None]
    survey: Survey
    totals: Totals
    laps: LapTable
    limits: dict[str, float]
    config_hash: str | None
    events: list[dict[str, Any]]


@dataclass(frozen=True)
class Comparison:
    """Two sessions side by side; `cells` changed the most in resistance."""

    a: SessionInfo
    b: SessionInfo
    figures_a: dict[str, float | None]
    figures_b: dict[str, float | None]
    histograms_a: dict[str, Histogram]
    histograms_b: dict[str, Histogram]
    cells: list[dict[str, Any]]


def report_of(session: SessionFile) -> Report:
    """Read a session and judge it."""
    info, collector = session.info, TotalsCollector()
    survey = survey_session(session, totals=collector)
    totals = collector.totals()
    source, found = find_laps(session, totals, None, None)
    laps = [figures_of(lap, totals) for lap in found]
    configs = session.configs()
    image = configs[-1].image if configs else None
    limits, events = limits_of(image), session.events()
    near, odd = margins(survey, limits), odd_cells(survey)
    trips = [event for event in events if event["severity"] == "trip" and event["code"] != "master-fault"]
    warned = [event for event in events if event["severity"] == "warning" and is_trigger("warning", event["code"])]
    return Report(
        info=info,
        headline=headline(survey, len(found)),
        why=verdicts(survey, odd, _cells(trips), _cells([each for each in warned if each["code"] == "joint-loose"])),
        limited=what_limited(near, list(dict.fromkeys(map(_told, trips)))),
        look_at=what_to_look_at(survey, odd, [_told(event) for event in warned], session.bad_frames()),
        margins=near,
        odd=odd,
        figures=key_figures(survey),
        survey=survey,
        totals=totals,
        laps=LapTable(source, laps, compare_drivers(laps)),
        limits=limits,
        config_hash=None if image is None else image_hash(image),
        events=events,
    )


def compare_sessions(first: SessionFile, second: SessionFile) -> Comparison:
    """Read two sessions and lay them side by side."""
    a, b = survey_session(first), survey_session(second)
    return Comparison(
        first.info, second.info, key_figures(a), key_figures(b), a.histograms, b.histograms, compare_cells(a, b)
    )


def histogram_json(histogram: Histogram) -> dict[str, Any]:
    """A histogram without the empty bins at its ends."""
    filled = np.flatnonzero(histogram.seconds)
    low, high = (int(filled[0]), int(filled[-1]) + 1) if filled.size else (0, 0)
    return {
        "unit": histogram.unit,
        "edges": histogram.edges[low : high + 1].round(6).tolist() if filled.size else [],
        "seconds": histogram.seconds[low:high].round(3).tolist(),
        "below_s": histogram.below_s,
        "above_s": histogram.above_s,
    }


def _cells(events: list[dict[str, Any]]) -> list[int]:
    return [event["cell"] for event in events if event["cell"] is not None]


def _told(event: dict[str, Any]) -> str:
    """The event with its place, once."""
    where = place(event["cell"])
    return str(event["text"]) if not where or where in event["text"] else f"{event['text']} ({where})"
