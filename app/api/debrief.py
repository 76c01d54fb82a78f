"""Looking back: laps of a session, black boxes."""

import time
from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse
from pydantic import BaseModel, Field

from app.analysis.laps import OVERLAY_POINTS, Lap
from app.api.deps import RuntimeDep, UserDep
from app.api.problems import invalid, not_found
from app.api.sessions import MAX_UNIX_S, open_session
from app.debrief.blackbox import keep_black_boxes
from app.debrief.blackbox_page import blackbox_page
from app.debrief.laps import CanCounter, LapTable, Overlay, Source, lap_table, overlay_laps, settle_laps
from app.runtime import Runtime
from app.sessions.blackboxes import StoredBox
from app.sessions.errors import UnknownSignal

router = APIRouter(tags=["debrief"])
SourceQuery = Annotated[Source | None, Query(description="none: settled, else markers, else the power's pattern")]
CanId = Annotated[int | None, Query(ge=0, lt=1 << 32, description="frame that counts laps; bit 31 marks a 29-bit id")]
CanByte = Annotated[int, Query(ge=0, le=63)]
CanMask = Annotated[int, Query(ge=1, le=255)]


class LapIn(BaseModel):
    """A lap as somebody settles it; times in unix seconds."""

    start_s: float = Field(ge=0, le=MAX_UNIX_S)
    end_s: float = Field(ge=0, le=MAX_UNIX_S)
    driver: str = Field("", max_length=200)
    note: str = Field("", max_length=200)
    counts: bool = True


class LapsIn(BaseModel):
    """All laps of a session; they replace what was settled before."""

    laps: list[LapIn] = Field(max_length=2000)


def _counter(can_id: int | None, byte: int, mask: int) -> CanCounter | None:
    return None if can_id is None else CanCounter(can_id, byte, mask)


@router.get("/sessions/{session_id}/laps")
def laps(
    session_id: str,
    runtime: RuntimeDep,
    source: SourceQuery = None,
    can_id: CanId = None,
    can_byte: CanByte = 0,
    can_mask: CanMask = 255,
) -> LapTable:
    """Laps with what each one cost, and drivers against each other."""
    with open_session(runtime, session_id) as file:
        return lap_table(file, source, _counter(can_id, can_byte, can_mask))


@router.put("/sessions/{session_id}/laps")
def settle(session_id: str, body: LapsIn, runtime: RuntimeDep, user: UserDep) -> LapTable:
    """Keep these laps in the session's file."""
    chosen = [Lap(**lap.model_dump()) for lap in body.laps]
    with open_session(runtime, session_id) as file:
        path = file.path
    settle_laps(path, chosen, t_wall_ns=time.time_ns(), who=user.name)
    runtime.note("info", "laps-settled", f"{len(chosen)} laps of {session_id} settled", user.name)
    with open_session(runtime, session_id) as file:
        return lap_table(file)


@router.delete("/sessions/{session_id}/laps")
def unsettle(session_id: str, runtime: RuntimeDep, user: UserDep) -> LapTable:
    """Take the settled laps back: they are found again out of the recording."""
    with open_session(runtime, session_id) as file:
        path = file.path
    settle_laps(path, None, t_wall_ns=time.time_ns(), who=user.name)
    with open_session(runtime, session_id) as file:
        return lap_table(file)


@router.get("/sessions/{session_id}/laps/overlay")
def overlay(
    session_id: str,
    runtime: RuntimeDep,
    lap: Annotated[list[int], Query(min_length=1, max_length=50, description="index from 0")],
    signal: Annotated[str, Query(max_length=100)] = "power_w",
    points: Annotated[int, Query(ge=10, le=2000)] = OVERLAY_POINTS,
    source: SourceQuery = None,
    can_id: CanId = None,
    can_byte: CanByte = 0,
    can_mask: CanMask = 255,
) -> Overlay:
    """One signal over laps laid on each other, part by part of the lap's time."""
    with open_session(runtime, session_id) as file:
        table = lap_table(file, source, _counter(can_id, can_byte, can_mask))
        try:
            return overlay_laps(file, [each.lap for each in table.laps], lap, signal, points)
        except UnknownSignal as error:
            raise invalid("signal", signal, str(error)) from error


@router.get("/blackboxes")
def black_boxes(runtime: RuntimeDep) -> list[StoredBox]:
    """What happened around every trip, newest first; outlives the sessions."""
    return runtime.black_boxes.store.stored()


@router.get("/blackboxes/{box_id}")
def black_box(box_id: str, runtime: RuntimeDep) -> dict[str, Any]:
    """One of them: the cell, value, limit, persistence, what the others did, every sample at full rate."""
    return _box(runtime, box_id)


@router.get("/blackboxes/{box_id}/page", response_class=HTMLResponse)
def black_box_page(box_id: str, runtime: RuntimeDep) -> HTMLResponse:
    """The same as one page to print."""
    return HTMLResponse(blackbox_page(_box(runtime, box_id)))


@router.get("/sessions/{session_id}/blackboxes")
def session_black_boxes(session_id: str, runtime: RuntimeDep) -> list[StoredBox]:
    """The black boxes of a session, newest first; those that are missing are made out of its file, and kept."""
    with open_session(runtime, session_id) as file:
        return keep_black_boxes(file, runtime.black_boxes.store)


def _box(runtime: Runtime, box_id: str) -> dict[str, Any]:
    box = runtime.black_boxes.store.get(box_id)
    if box is None:
        raise not_found("black box", box_id)
    return box
