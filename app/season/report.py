"""The season report: sessions, trends, cells with reasons, curves of those that limit soonest; as data and HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Final

from app.analysis.totals import listed
from app.battery.battery import Battery
from app.season.history import CellHistory
from app.season.overview import SeasonCurve, SeasonOverview, curve_of, overview_of
from app.season.tags import tags_of
from app.sessions.info import SessionInfo

CURVES: Final = 3


@dataclass(frozen=True)
class SeasonSession:
    """A session of the season with its tags, and whose it is, as the lake names the car."""

    id: str
    car: str
    name: str
    start_s: float
    duration_s: float
    tags: dict[str, str]


@dataclass(frozen=True)
class SeasonCell:
    """A cell of a car over the season, a value a session.

    Attributes:
        sessions: their ids, the oldest first.
        module: how many modules were in its place before.
        resistance_ohm: as measured, with the joint.
    """

    car: str
    cell: int
    sessions: list[str]
    module: list[int]
    resistance_ohm: list[float | None]
    resistance: SeasonCurve
    capacity: SeasonCurve
    self_discharge: SeasonCurve


@dataclass(frozen=True)
class SeasonReport:
    """Everything that the printed season report shows."""

    battery: str
    segments: list[int]
    made_s: float
    voltwall: str
    sessions: list[SeasonSession]
    cars: list[CarReport]


@dataclass(frozen=True)
class CarReport:
    """Results of the sessions of one car, and the curves of its weakest cells."""

    overview: SeasonOverview
    curves: list[SeasonCell]


def session_of(info: SessionInfo, car: str) -> SeasonSession:
    """Return what the season shows of a session."""
    return SeasonSession(info.id, car, info.name, info.started_wall_ns / 1e9, info.duration_s, tags_of(info))


def season_report(
    battery: Battery, histories: Sequence[CellHistory], infos: list[SessionInfo], made_s: float, version: str
) -> SeasonReport:
    """Return the report of those of the sessions, the oldest first, that the histories hold."""
    car_of = {session: history.car for history in histories for session in history.sessions}
    sessions = [session_of(info, car_of[info.id]) for info in infos if info.id in car_of]
    chosen = {session.id for session in sessions}
    cars = [_car(history.only(chosen), battery) for history in histories if chosen & {*history.sessions}]
    return SeasonReport(battery.name, list(battery.segments), made_s, version, sessions, cars)


def _car(history: CellHistory, battery: Battery) -> CarReport:
    overview = overview_of(history, battery.segments)
    weakest = [cell.cell for cell in overview.cells[:CURVES] if cell.reasons]
    return CarReport(overview, [cell_of(history, cell) for cell in weakest])


def cell_of(history: CellHistory, cell: int) -> SeasonCell:
    """Return a cell over the sessions of a car."""
    return SeasonCell(
        history.car,
        cell,
        list(history.sessions),
        history.module[:, cell].astype(int).tolist(),
        listed(history.resistance_ohm[:, cell], 7),
        *(curve_of(history, cell, name) for name in ("resistance", "capacity", "self_discharge")),
    )


def season_document(report: SeasonReport, language: str = "en") -> str:
    """Return the report as one HTML file.

    Raises:
        NotBuilt: the front end was not built.
    """
    from app.analysis.document import page_of  # it imports what a race report is made of

    return page_of("season", asdict(report), language)
