"""The season report: sessions, trends, cells with reasons, curves of those that limit soonest; as data and HTML."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Final

from app.battery.battery import Battery
from app.season.cells.history import CellHistory
from app.season.overview import SeasonCurve, SeasonOverview, curve_of, overview_of
from app.season.tags import tags_of
from app.sessions.info import SessionInfo

CURVES: Final = 3


@dataclass(frozen=True)
class SeasonSession:
    """A session of the season with its tags."""

    id: str
    name: str
    start_s: float
    duration_s: float
    tags: dict[str, str]


@dataclass(frozen=True)
class SeasonCellCurves:
    """Both quantities of a cell over the season."""

    cell: int
    resistance: SeasonCurve
    capacity: SeasonCurve


@dataclass(frozen=True)
class SeasonReport:
    """Everything that the printed season report shows."""

    battery: str
    segments: list[int]
    made_s: float
    voltwall: str
    sessions: list[SeasonSession]
    overview: SeasonOverview
    curves: list[SeasonCellCurves]


def session_of(info: SessionInfo) -> SeasonSession:
    """Return what the season shows of a session."""
    return SeasonSession(info.id, info.name, info.started_wall_ns / 1e9, info.duration_s, tags_of(info))


def season_report(
    battery: Battery, history: CellHistory, sessions: list[SessionInfo], made_s: float, version: str
) -> SeasonReport:
    """Return the report of sessions, the oldest first."""
    found = overview_of(history, battery.segments)
    weakest = [each.cell for each in found.cells[:CURVES] if each.reasons]
    return SeasonReport(
        battery.name,
        list(battery.segments),
        made_s,
        version,
        [session_of(info) for info in sessions],
        found,
        [curves_of(history, cell) for cell in weakest],
    )


def curves_of(history: CellHistory, cell: int) -> SeasonCellCurves:
    """Return both curves of a cell."""
    return SeasonCellCurves(cell, curve_of(history, cell, "resistance"), curve_of(history, cell, "capacity"))


def season_document(report: SeasonReport, language: str = "en") -> str:
    """Return the report as one HTML file.

    Raises:
        NotBuilt: the front end was not built.
    """
    from app.analysis.document import page_of  # it imports what a race report is made of

    return page_of("season", asdict(report), language)
