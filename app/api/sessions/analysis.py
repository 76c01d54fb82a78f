"""Looking back: laps of a session, black boxes, reports, comparisons."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import asdict
from hashlib import sha256
from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse
from pydantic import Field

from app.analysis.black_box.box import BlackBox
from app.analysis.black_box.from_session import explained, is_explained, keep_black_boxes, stored_box
from app.analysis.document import Subject, document
from app.analysis.evidence.evidence import Evidence, NoEvidence, evidence_of
from app.analysis.laps.figures import OVERLAY_POINTS, Lap
from app.analysis.laps.from_session import CanCounter, LapTable, Overlay, Source, lap_table, settle_laps
from app.analysis.limits import by_names_of_profiles, limits_of
from app.analysis.report.report import Report, SessionComparison, report_of
from app.api.schemas.battery import BatteryOut, battery_json
from app.api.schemas.sessions import BoxList
from app.api.sessions.jobs import comparison_at, of_session, overlay_at
from app.api.sessions.routes import MAX_UNIX_S
from app.api.web.dependencies import (
    BlackBoxesPart,
    BoxesOfSessionsPart,
    CataloguePart,
    ClockPart,
    EventsPart,
    UserDep,
    WorkersPart,
)
from app.api.web.paging import CursorQuery, LimitQuery, page_of
from app.api.web.problems import invalid, not_found
from app.api.web.request_body import Body
from app.errors import AppError
from app.sessions.black_box_store import StoredBox
from app.sessions.errors import UnknownSignal
from app.sessions.worker import REPORT
from app.words import Message, languages

router = APIRouter(tags=["debrief"])


_SCRIPT = '<script type="module">'
_POLICY = (
    "default-src 'none'; script-src {}; style-src 'unsafe-inline'; font-src data:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


def document_response(subject: Subject, language: str) -> HTMLResponse:
    """Return a report, a black box or a reaction test as one HTML file.

    Raises:
        NotBuilt: the front end was not built.
    """
    page = document(subject, language)
    script = page.partition(_SCRIPT)[2].partition("</script>")[0]
    allowed = f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'"
    return HTMLResponse(page, headers={"Content-Security-Policy": _POLICY.format(allowed)})


SourceQuery = Annotated[Source | None, Query(description="none: settled, else markers, else the power's pattern")]
CanId = Annotated[int | None, Query(ge=0, lt=1 << 32, description="frame that counts laps; bit 31 marks a 29-bit id")]
CanByte = Annotated[int, Query(ge=0, le=63)]
CanMask = Annotated[int, Query(ge=1, le=255)]
LapSignal = Annotated[
    str | None, Query(max_length=100, description="with source=signal: a signal that goes up when a lap begins")
]


Language = Annotated[str, Query(pattern=f"^({'|'.join(languages())})$", description="of the document's words")]


class LapIn(Body):
    """A lap as somebody settles it; times in unix seconds."""

    start_s: float = Field(ge=0, le=MAX_UNIX_S)
    end_s: float = Field(ge=0, le=MAX_UNIX_S)
    driver: str = Field("", max_length=200)
    note: str = Field("", max_length=200)
    counts: bool = True
    is_partial: bool = False


class LapsIn(Body):
    """All laps of a session; they replace what was settled before."""

    laps: list[LapIn] = Field(max_length=2000)


def _box_list(boxes: Sequence[StoredBox], limit: int | None, cursor: str | None) -> BoxList:
    shown, following = page_of(boxes, lambda box: (round(box.time * 1e9), box.id), limit, cursor)
    return BoxList.model_validate({"boxes": [asdict(box) for box in shown], "next_cursor": following})


def _counter(can_id: int | None, byte: int, mask: int) -> CanCounter | None:
    return None if can_id is None else CanCounter(can_id, byte, mask)


@router.get("/sessions/{session_id}/battery", response_model=BatteryOut)
def battery(session_id: str, catalogue: CataloguePart) -> dict[str, Any]:
    """The battery that was recorded, with the limits in force at the end, as far as they are known."""
    with catalogue.open(session_id) as file:
        configs = file.configs()
        limits_then = by_names_of_profiles(limits_of(configs[-1].image if configs else None))
        body = battery_json(file.battery, "recording", Message("a-recording-is-not-written"))
    return body | {"limits": body["limits"] | limits_then}


@router.get("/sessions/{session_id}/laps")
def laps(
    session_id: str,
    catalogue: CataloguePart,
    workers: WorkersPart,
    source: SourceQuery = None,
    can_id: CanId = None,
    can_byte: CanByte = 0,
    can_mask: CanMask = 255,
    lap_signal: LapSignal = None,
) -> LapTable:
    """Laps with what each one cost, and drivers against each other."""
    counter = lap_signal if source == "signal" else _counter(can_id, can_byte, can_mask)
    try:
        return workers.run(REPORT, of_session, catalogue.path(session_id), lap_table, source, counter)
    except UnknownSignal as error:
        raise invalid("lap_signal", error.name, error.reason) from error


@router.put("/sessions/{session_id}/laps")
def settle(
    session_id: str, body: LapsIn, events: EventsPart, catalogue: CataloguePart, clock: ClockPart, user: UserDep
) -> LapTable:
    """Keep these laps in the session's file."""
    chosen = [Lap(**lap.model_dump()) for lap in body.laps]
    with catalogue.open(session_id) as file:
        path = file.path
    settle_laps(path, chosen, t_wall_ns=clock.wall_ns(), who=user.name)
    events.note("info", "laps-settled", Message("laps-settled", n=len(chosen), session=session_id), user.name)
    with catalogue.open(session_id) as file:
        return lap_table(file)


@router.delete("/sessions/{session_id}/laps")
def unsettle(session_id: str, catalogue: CataloguePart, clock: ClockPart, user: UserDep) -> LapTable:
    """Take the settled laps back: they are found again out of the recording."""
    with catalogue.open(session_id) as file:
        path = file.path
    settle_laps(path, None, t_wall_ns=clock.wall_ns(), who=user.name)
    with catalogue.open(session_id) as file:
        return lap_table(file)


@router.get("/sessions/{session_id}/laps/overlay")
def overlay(
    session_id: str,
    catalogue: CataloguePart,
    workers: WorkersPart,
    lap: Annotated[list[int], Query(min_length=1, max_length=50, description="index from 0")],
    signal: Annotated[str, Query(max_length=100)] = "power_w",
    points: Annotated[int, Query(ge=10, le=2000)] = OVERLAY_POINTS,
    along: Annotated[
        str | None,
        Query(
            max_length=100,
            description="by distance: a speed or a place as a signal, MESSAGE.SIGNAL of the battery's DBC or"
            " can:ID:BYTE[:BYTES]; auto: what is known, else by time",
        ),
    ] = None,
    source: SourceQuery = None,
    can_id: CanId = None,
    can_byte: CanByte = 0,
    can_mask: CanMask = 255,
    lap_signal: LapSignal = None,
) -> Overlay:
    """One signal over laps laid on each other, part by part of the lap's time or way."""
    counter = lap_signal if source == "signal" else _counter(can_id, can_byte, can_mask)
    path = catalogue.path(session_id)
    try:
        return workers.run(REPORT, overlay_at, path, source, counter, lap, signal, points, along)
    except UnknownSignal as error:
        field = "lap_signal" if error.name == lap_signal else "signal"
        raise invalid(field, error.name, error.reason) from error


@router.get("/blackboxes")
def black_boxes(
    black_boxes: BlackBoxesPart, of_sessions: BoxesOfSessionsPart, limit: LimitQuery = None, cursor: CursorQuery = None
) -> BoxList:
    """Return the black boxes of all trips, newest first; they outlive the sessions. Old sessions are read meanwhile."""
    of_sessions.update()
    return _box_list(black_boxes.store.stored(), limit, cursor)


@router.get("/blackboxes/{box_id}")
def black_box(box_id: str, black_boxes: BlackBoxesPart, catalogue: CataloguePart) -> BlackBox:
    """One of them: the cell, value, limit, the likely cause, what the others did, every sample at full rate."""
    box = stored_box(black_boxes.store, box_id)
    if box is None:
        raise not_found("black box", box_id)
    if is_explained(box) or box.session_id is None:
        return box
    try:
        with catalogue.open(box.session_id) as file:
            return explained(file, box)
    except AppError:
        return box


@router.get("/blackboxes/{box_id}/page", response_class=HTMLResponse)
def black_box_page(
    box_id: str, black_boxes: BlackBoxesPart, catalogue: CataloguePart, language: Language = "en"
) -> HTMLResponse:
    """The same as one HTML file, to print or to hand over."""
    return document_response(black_box(box_id, black_boxes, catalogue), language)


@router.get("/sessions/{session_id}/blackboxes")
def session_black_boxes(
    session_id: str,
    black_boxes: BlackBoxesPart,
    catalogue: CataloguePart,
    limit: LimitQuery = None,
    cursor: CursorQuery = None,
) -> BoxList:
    """The black boxes of a session, newest first; those that are missing are made out of its file, and kept."""
    with catalogue.open(session_id) as file:
        return _box_list(keep_black_boxes(file, black_boxes.store), limit, cursor)


@router.get("/sessions/{session_id}/report")
def report(session_id: str, catalogue: CataloguePart, workers: WorkersPart) -> Report:
    """Return the report of a session: result, limits reached and recommended checks, with figures and curves."""
    return workers.run(REPORT, of_session, catalogue.path(session_id), report_of)


@router.get("/sessions/{session_id}/report/page", response_class=HTMLResponse)
def report_as_page(
    session_id: str, catalogue: CataloguePart, workers: WorkersPart, language: Language = "en"
) -> HTMLResponse:
    """The report as one HTML file with its charts inside, to print or to keep."""
    return document_response(report(session_id, catalogue, workers), language)


@router.get("/sessions/{session_id}/compare/{other_id}")
def compare(session_id: str, other_id: str, catalogue: CataloguePart, workers: WorkersPart) -> SessionComparison:
    """Two sessions side by side: key figures, histograms, and the cells that changed the most."""
    return workers.run(REPORT, comparison_at, catalogue.path(session_id), catalogue.path(other_id))


@router.get("/sessions/{session_id}/evidence")
def evidence(session_id: str, catalogue: CataloguePart, workers: WorkersPart) -> Evidence:
    """Return the reaction times of the master, of a session that `voltwall evidence` recorded."""
    try:
        return workers.run(REPORT, of_session, catalogue.path(session_id), evidence_of)
    except NoEvidence as error:
        raise not_found("reaction test", session_id) from error


@router.get("/sessions/{session_id}/evidence/page", response_class=HTMLResponse)
def evidence_as_page(
    session_id: str, catalogue: CataloguePart, workers: WorkersPart, language: Language = "en"
) -> HTMLResponse:
    """The same as one HTML file, to print and to sign."""
    return document_response(evidence(session_id, catalogue, workers), language)
