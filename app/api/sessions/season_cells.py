"""The season: sessions with tags, trends, cells, swaps of modules, what estimating again changed."""

from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Response
from pydantic import Field

from app.api.schemas.sessions import DeletedOut
from app.api.sessions.routes import MAX_UNIX_S
from app.api.web.dependencies import (
    CataloguePart,
    ClockPart,
    EventsPart,
    SeasonPart,
    SeasonSourcePart,
    SettingsPart,
    SwapsPart,
    UserDep,
    WorkersPart,
)
from app.api.web.problems import invalid, not_found
from app.api.web.request_body import Body
from app.battery.fields import MOST_CELLS
from app.season.answers import (
    LIMITS,
    cars_at,
    cell_at,
    overviews_at,
    report_at,
)
from app.season.estimates.changes import EstimateChange, changes
from app.season.estimates.results import EstimateSet, Results
from app.season.lake.facts import where_of
from app.season.overview import SeasonOverview
from app.season.report import SeasonCell, SeasonSession, session_of
from app.season.tags import LONGEST, NAMES, matches, write_tags
from app.sessions.info import SessionInfo
from app.sessions.swaps import Swap
from app.words import Message

router = APIRouter(prefix="/season", tags=["season"])
Words = Annotated[str, Query(max_length=200, description="words of names and tags; `tyres:wet`, `since:2026-03-01`")]
Car = Annotated[
    str, Query(max_length=200, pattern=r"^[^\x00]*$", description="of this car alone; empty: of each, never mixed")
]


@dataclass(frozen=True)
class Season:
    """The sessions of the lake that match, the oldest first, and what they say of each car, which share nothing.

    Attributes:
        to_read: sessions that are on their way into the lake.
        is_kept: this service brings its lake up to date.
        cars: all of the lake with this battery, as the lake names them.
        overviews: of each car that has a session that matches.
        swaps: of modules, of the chosen car or of all.
    """

    sessions: list[SeasonSession]
    all_sessions: int
    to_read: int
    is_kept: bool
    tag_names: list[str]
    cars: list[str]
    overviews: list[SeasonOverview]
    swaps: list[Swap]


@dataclass(frozen=True)
class SeasonChanges:
    """Changes by a new estimation; `after` and `before` are sets, None where there is none."""

    sets: list[str]
    after: EstimateSet | None
    before: EstimateSet | None
    changes: list[EstimateChange]


class NewSwap(Body):
    """Modules that were replaced."""

    cells: list[int] = Field(min_length=1, max_length=MOST_CELLS, description="indices from 0")
    time_s: float | None = Field(None, ge=0, le=MAX_UNIX_S, description="unix time; none: now")
    note: str = Field("", max_length=500)
    car: str = Field("", max_length=200, description="whose; empty: of the only car there is")


class NewTags(Body):
    """All tags of a session; what is left out or empty is taken away."""

    tags: dict[Annotated[str, Field(max_length=20)], Annotated[str, Field(max_length=LONGEST)]] = Field(max_length=40)


def _chosen(catalogue: CataloguePart, words: str) -> list[SessionInfo]:
    return [info for info in reversed(catalogue.list()) if matches(info, words)]


def _ids(infos: list[SessionInfo]) -> set[str]:
    return {info.id for info in infos}


@router.get("")
def season_now(
    source: SeasonSourcePart,
    season: SeasonPart,
    catalogue: CataloguePart,
    workers: WorkersPart,
    words: Words = "",
    car: Car = "",
) -> Season:
    """The season, out of the lake; sessions that are new or have changed are built in the background meanwhile."""
    closed = [info for info in catalogue.list() if info.is_closed]
    season.update(info.path for info in closed)
    chosen = _chosen(catalogue, words)
    ids = _ids(chosen)
    car_of, overviews = season.remembered(
        (source, sorted(ids), car), lambda: workers.run(LIMITS, overviews_at, source, ids, car)
    )
    lacking = [info for info in closed if info.id not in car_of and source.may_hold(info)]
    sessions = [session_of(info, car_of[info.id]) for info in chosen if info.id in car_of]
    return Season(
        [session for session in sessions if car in ("", session.car)],
        len(car_of),
        len(lacking) if season.is_building else 0,
        season.builds,
        list(NAMES),
        sorted(set(car_of.values())),
        overviews,
        [swap for swap in source.swaps if not car or swap.is_of(car)],
    )


@router.get("/cells/{cell}")
def season_cell(
    cell: Annotated[int, Path(ge=0, lt=MOST_CELLS)],
    source: SeasonSourcePart,
    catalogue: CataloguePart,
    workers: WorkersPart,
    words: Words = "",
    car: Car = "",
) -> list[SeasonCell]:
    """A cell of each car over the season: resistance, capacity, self-discharge, the lines through them, its modules."""
    if cell >= source.battery.n_cells:
        raise invalid("cell", cell, f"0..{source.battery.n_cells - 1}")
    return workers.run(LIMITS, cell_at, source, _ids(_chosen(catalogue, words)), car, cell)


@router.post("/swaps", status_code=201)
def swap_modules(
    body: NewSwap,
    source: SeasonSourcePart,
    swaps: SwapsPart,
    workers: WorkersPart,
    clock: ClockPart,
    events: EventsPart,
    user: UserDep,
) -> list[Swap]:
    """Record that modules of a car were swapped: what is in these places from then on inherits nothing."""
    at_s = clock.wall_s() if body.time_s is None else body.time_s
    swaps.add(body.cells, at_s, body.note, user.name, body.car, workers.run(LIMITS, cars_at, source))
    events.note("info", "module-swapped", Message("modules-swapped", n=len(body.cells), note=body.note), user.name)
    return swaps.read()


@router.delete("/swaps/{swap_id}", response_model=DeletedOut)
def take_swap_back(
    swap_id: Annotated[int, Path(ge=0, lt=1 << 63)], swaps: SwapsPart, events: EventsPart, user: UserDep
) -> dict[str, Any]:
    """Take a swap back."""
    if not swaps.remove(swap_id):
        raise not_found("swap", str(swap_id))
    events.note("info", "module-swapped", Message("swap-taken-back", swap=swap_id), user.name)
    return {"deleted": True}


@router.get("/changes")
def season_changes(
    settings: SettingsPart,
    after: Annotated[str, Query(max_length=200)] = "",
    before: Annotated[str, Query(max_length=200)] = "",
) -> SeasonChanges:
    """Return the changes of `voltwall season estimate`: a set of results against another; by default the newest two."""
    results = Results(settings.data)
    sets = results.sets()
    names = [estimate_set.id for estimate_set in sets]
    new = results.find(after) if after else (sets[0] if sets else None)
    others = [estimate_set for estimate_set in sets if estimate_set != new]
    old = results.find(before) if before else (others[0] if others else None)
    changed = changes([] if old is None else results.read_all(old), results.read_all(new) if new else [])
    return SeasonChanges(names, new, old, changed)


@router.put("/sessions/{session_id}/tags")
def tag_session(
    session_id: str, body: NewTags, catalogue: CataloguePart, clock: ClockPart, events: EventsPart, user: UserDep
) -> SeasonSession:
    """Set the tags of a session; they are kept in its file."""
    path = catalogue.path(session_id)
    write_tags(path, body.tags, t_wall_ns=clock.wall_ns(), who=user.name)
    events.note("info", "session-tagged", Message("session-tagged", session=session_id), user.name)
    with catalogue.open(session_id) as session:
        return session_of(session.info, where_of(session).car)


@router.get("/report", response_class=Response, responses={200: {"content": {"text/html": {}}}})
def season_report_page(
    source: SeasonSourcePart,
    catalogue: CataloguePart,
    workers: WorkersPart,
    clock: ClockPart,
    words: Words = "",
    language: Annotated[str, Query(pattern="^(en|nb)$")] = "en",
    car: Car = "",
) -> Response:
    """The season report as one HTML file, to print or to hand over."""
    made = workers.run(LIMITS, report_at, source, _chosen(catalogue, words), car, clock.wall_s(), language)
    return Response(made, media_type="text/html; charset=utf-8")
