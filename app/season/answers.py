"""What the pages of the season show, each answer out of a lake in one call: for a worker process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

from app import __version__
from app.season.cells.compare import SeasonCellDifference, SeasonDifference, compare
from app.season.cells.history import CellHistory, SeasonSource
from app.season.matching.places import WithoutModule, without
from app.season.modules import modules_of
from app.season.overview import SeasonOverview, overview_of
from app.season.report import SeasonCellCurves, curves_of, season_document, season_report
from app.sessions.info import SessionInfo
from app.sessions.worker import Limits
from app.words import naming_cells

LIMITS: Final = Limits(120)
T = TypeVar("T")


def overview_at(source: SeasonSource, chosen: set[str]) -> tuple[list[str], SeasonOverview]:
    """Return the ids of all sessions of the lake, and what the chosen ones say."""

    def overview(history: CellHistory) -> tuple[list[str], SeasonOverview]:
        return list(history.sessions), overview_of(history.only(chosen), source.battery.segments)

    return _answer(source, overview)


def curves_at(source: SeasonSource, chosen: set[str], cell: int) -> SeasonCellCurves:
    """Return both curves of a cell."""
    return _answer(source, lambda history: curves_of(history.only(chosen), cell))


def comparison_at(
    source: SeasonSource, a: set[str], b: set[str]
) -> tuple[int, int, list[SeasonDifference], list[SeasonCellDifference]]:
    """Return how many sessions of the lake each group has, and how group `b` differs from group `a`."""

    def comparison(
        history: CellHistory,
    ) -> tuple[int, int, list[SeasonDifference], list[SeasonCellDifference]]:
        known = set(history.sessions)
        return len(a & known), len(b & known), *compare(history, a, b)

    return _answer(source, comparison)


def without_at(source: SeasonSource, removed: list[int], current_a: float) -> tuple[WithoutModule, bool]:
    """Return the accumulator without some modules, and whether capacities were measured.

    Raises:
        ConfigError: nothing was measured of any module.
    """

    def less(history: CellHistory) -> tuple[WithoutModule, bool]:
        modules = modules_of(history)
        found = without(removed, modules.capacity_ah, modules.capacity_sigma_ah, modules.resistance_ohm, current_a)
        return found, modules.has_capacity

    return _answer(source, less)


def report_at(source: SeasonSource, infos: list[SessionInfo], made_s: float, language: str) -> str:
    """Return the season report as one HTML file.

    Raises:
        NotBuilt: the front end was not built.
    """

    def report(history: CellHistory) -> str:
        known = set(history.sessions)
        chosen = [info for info in infos if info.id in known]
        only = history.only({info.id for info in chosen})
        return season_document(season_report(source.battery, only, chosen, made_s, __version__), language)

    return _answer(source, report)


def _answer(source: SeasonSource, make: Callable[[CellHistory], T]) -> T:
    with naming_cells(source.battery.segments):
        return make(source.history())
