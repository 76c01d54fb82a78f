"""The season: sessions with tags, trends, cells by what limits soonest, comparison, what estimating again changed."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Path, Query, Response
from pydantic import Field

from app import __version__
from app.api.web.dependencies import CataloguePart, ClockPart, EventsPart, SeasonCellsPart, UserDep
from app.api.web.problems import invalid
from app.api.web.request_body import Body
from app.battery.fields import MOST_CELLS
from app.season.cells.compare import SeasonCellDifference, SeasonDifference, compare
from app.season.cells.keeper import SeasonKeeper
from app.season.estimates.changes import EstimateChange, changes
from app.season.estimates.results import EstimateSet
from app.season.matching.places import WithoutModule, without
from app.season.modules import modules_of
from app.season.overview import SeasonOverview, overview_of
from app.season.report import SeasonCellCurves, SeasonSession, curves_of, season_document, season_report, session_of
from app.season.tags import LONGEST, NAMES, matches, write_tags
from app.sessions.info import SessionInfo
from app.words import Message

router = APIRouter(prefix="/season", tags=["season"])
Words = Annotated[str, Query(max_length=200, description="words of names and tags; `tyres:wet`, `since:2026-03-01`")]


@dataclass(frozen=True)
class Season:
    """The sessions that match, the oldest first, and what they say; `reading` of `to_read` while more are read."""

    sessions: list[SeasonSession]
    all_sessions: int
    reading: int
    to_read: int
    tag_names: list[str]
    overview: SeasonOverview


@dataclass(frozen=True)
class SeasonComparison:
    """Group B against group A: figures of the accumulator, and cells that changed against the others."""

    sessions_a: int
    sessions_b: int
    differences: list[SeasonDifference]
    cells: list[SeasonCellDifference]


@dataclass(frozen=True)
class SeasonChanges:
    """What estimating again changed; `after` and `before` are sets, None where there is none."""

    sets: list[str]
    after: EstimateSet | None
    before: EstimateSet | None
    changes: list[EstimateChange]


@dataclass(frozen=True)
class SeasonWithout:
    """The accumulator without some modules; `has_capacity`: their capacities were measured."""

    without: WithoutModule
    has_capacity: bool


class NewTags(Body):
    """All tags of a session; what is left out or empty is taken away."""

    tags: dict[Annotated[str, Field(max_length=20)], Annotated[str, Field(max_length=LONGEST)]]


def _chosen(season: SeasonKeeper, words: str) -> list[SessionInfo]:
    known = season.passports.store.known()
    return [info for info in reversed(season.catalogue.list()) if info.id in known and matches(info, words)]


@router.get("")
def season_now(season: SeasonCellsPart, words: Words = "") -> Season:
    """The season; sessions that are new are read and estimated in the background meanwhile."""
    season.update()
    chosen = _chosen(season, words)
    history = season.history().only({info.id for info in chosen})
    reading, to_read = season.progress
    return Season(
        [session_of(info) for info in chosen],
        len(season.passports.store.known()),
        reading,
        to_read,
        list(NAMES),
        overview_of(history, season.passports.battery.segments),
    )


@router.get("/cells/{cell}")
def season_cell(
    cell: Annotated[int, Path(ge=0, lt=MOST_CELLS)], season: SeasonCellsPart, words: Words = ""
) -> SeasonCellCurves:
    """Resistance and capacity of one cell over the season, with the band of its ageing, also 90 days ahead."""
    if cell >= season.passports.battery.n_cells:
        raise invalid("cell", cell, f"0..{season.passports.battery.n_cells - 1}")
    return curves_of(season.history().only({info.id for info in _chosen(season, words)}), cell)


@router.get("/compare")
def season_compare(season: SeasonCellsPart, a: Words = "", b: Words = "") -> SeasonComparison:
    """Two groups of sessions against each other, by words as in the search; a session of both counts in A alone."""
    first = {info.id for info in _chosen(season, a)}
    second = {info.id for info in _chosen(season, b)} - first
    return SeasonComparison(len(first), len(second), *compare(season.history(), first, second))


@router.get("/without")
def season_without(
    season: SeasonCellsPart,
    cells: Annotated[
        str, Query(max_length=400, pattern=r"^\d{1,4}(,\d{1,4})*$", description="indices from 0, as 30,31")
    ],
    current_a: Annotated[float, Query(ge=0, le=10_000)] = 150.0,
) -> SeasonWithout:
    """What the accumulator would be without some modules."""
    removed = sorted({int(part) for part in cells.split(",")})
    n_cells = season.passports.battery.n_cells
    if removed[-1] >= n_cells or len(removed) >= n_cells:
        raise invalid("cells", cells, f"some of 0..{n_cells - 1}, not all")
    modules = modules_of(season.history())
    found = without(removed, modules.capacity_ah, modules.capacity_sigma_ah, modules.resistance_ohm, current_a)
    return SeasonWithout(found, modules.has_capacity)


@router.get("/changes")
def season_changes(
    season: SeasonCellsPart,
    after: Annotated[str, Query(max_length=200)] = "",
    before: Annotated[str, Query(max_length=200)] = "",
) -> SeasonChanges:
    """What `voltwall season estimate` changed: a set of results against another; by default the newest two."""
    sets = season.results.sets()
    names = [each.id for each in sets]
    new = season.results.find(after) if after else (sets[0] if sets else None)
    others = [each for each in sets if each != new]
    old = season.results.find(before) if before else (others[0] if others else None)
    found = changes([] if old is None else season.results.read_all(old), season.results.read_all(new) if new else [])
    return SeasonChanges(names, new, old, found)


@router.put("/sessions/{session_id}/tags")
def tag_session(
    session_id: str, body: NewTags, catalogue: CataloguePart, clock: ClockPart, events: EventsPart, user: UserDep
) -> SeasonSession:
    """Set the tags of a session; they are kept in its file."""
    path = catalogue.path(session_id)
    write_tags(path, body.tags, t_wall_ns=clock.wall_ns(), who=user.name)
    events.note("info", "session-tagged", Message("session-tagged", session=session_id), user.name)
    with catalogue.open(session_id) as session:
        return session_of(session.info)


@router.get("/report", response_class=Response, responses={200: {"content": {"text/html": {}}}})
def season_report_page(
    season: SeasonCellsPart,
    clock: ClockPart,
    words: Words = "",
    language: Annotated[str, Query(pattern="^(en|nb)$")] = "en",
) -> Response:
    """The season report as one HTML file, to print or to hand over."""
    chosen = _chosen(season, words)
    history = season.history().only({info.id for info in chosen})
    report = season_report(season.passports.battery, history, chosen, clock.wall_s(), __version__)
    return Response(season_document(report, language), media_type="text/html; charset=utf-8")
