"""Answers of the season's pages, each out of a lake in one call: for a worker process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from app import __version__
from app.season.history import CellHistory, SeasonSource
from app.season.overview import SeasonOverview, overview_of
from app.season.report import SeasonCell, cell_of, season_document, season_report
from app.sessions.info import SessionInfo
from app.sessions.worker import JobLimits

LIMITS: Final = JobLimits(120)


def overviews_at(source: SeasonSource, chosen: set[str], car: str) -> tuple[dict[str, str], list[SeasonOverview]]:
    """Return the car of every session of the lake by the session's id, and what the chosen ones say of each car.

    Args:
        source: which season.
        chosen: ids of sessions.
        car: of this car alone; empty: of all, each by itself.
    """
    histories = source.histories()
    car_of = {session: history.car for history in histories for session in history.sessions}
    wanted = [history for history in histories if car in ("", history.car)]
    return car_of, [overview_of(history, source.battery.segments) for history in _only(wanted, chosen)]


def cell_at(source: SeasonSource, chosen: set[str], car: str, cell: int) -> list[SeasonCell]:
    """Return a cell of each car that has a chosen session.

    Raises:
        ConfigError: there is no such car.
    """
    return [cell_of(history, cell) for history in _only(source.histories(car), chosen)]


def cars_at(source: SeasonSource) -> list[str]:
    """Return the cars of the lake with this battery."""
    return [history.car for history in source.histories()]


def report_at(source: SeasonSource, infos: list[SessionInfo], car: str, made_s: float, language: str) -> str:
    """Return the season report as one HTML file.

    Raises:
        ConfigError: there is no such car.
        NotBuilt: the front end was not built.
    """
    report = season_report(source.battery, source.histories(car), infos, made_s, __version__)
    return season_document(report, language)


def _only(histories: Sequence[CellHistory], chosen: set[str]) -> list[CellHistory]:
    """The chosen sessions of each car that has any."""
    return [history.only(chosen) for history in histories if chosen & {*history.sessions}]
