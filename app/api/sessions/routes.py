"""Sessions: list, record, mark, look into, take away, replay."""

import base64
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import orjson
from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse
from pydantic import Field
from starlette.background import BackgroundTask

from app.analysis.laps.from_session import LAP_KINDS
from app.api.encoding.sessions import event_json, marker_json, session_json, unreadable_json
from app.api.schemas.sessions import (
    DeletedOut,
    MarkedOut,
    MarkersOut,
    ReplayChoicesOut,
    ReplayStateOut,
    SessionDetailOut,
    SessionOut,
    SessionSeriesOut,
    SessionsOut,
    StoppedOut,
)
from app.api.sessions.jobs import export_at
from app.api.web.dependencies import (
    CataloguePart,
    EventsPart,
    LivePart,
    PipelinesPart,
    RecorderPart,
    ReplayPart,
    UserDep,
    WorkersPart,
)
from app.api.web.paging import CursorQuery, LimitQuery, page_of
from app.api.web.problems import Problem, invalid
from app.api.web.request_body import Body
from app.estimation.filters.estimators import FILTERS
from app.sessions.errors import SessionError, UnknownSignal
from app.sessions.export.formats import FORMATS, Names
from app.sessions.replay import SESSION_CELL, ReplayOptions
from app.sessions.replay_schedule import MAX_SPEED, MIN_SPEED
from app.sessions.storage.files import sha256
from app.sessions.storage.signals import LONGEST_NAME
from app.sessions.worker import EXPORT
from app.words import Message

SQLITE = "application/vnd.sqlite3"
router = APIRouter(tags=["sessions"])
ExportFormat = Annotated[str, Query(alias="format", json_schema_extra={"enum": [*FORMATS]})]
SignalName = Annotated[str, Field(max_length=LONGEST_NAME)]
MAX_UNIX_S = 9e9  # beyond it nanoseconds do not fit a 64-bit number
From = Annotated[float | None, Query(alias="from", ge=0, le=MAX_UNIX_S, description="unix time, s")]
To = Annotated[float | None, Query(alias="to", ge=0, le=MAX_UNIX_S, description="unix time, s")]


class NewSession(Body):
    """The name of a new session."""

    name: str | None = Field(None, max_length=120)


class NewMarker(Body):
    """A note at this instant."""

    text: str = Field(max_length=500)
    kind: str = Field("note", max_length=40)
    ago_s: float = Field(
        0.0, ge=0, le=600, description="how long ago it was: a note is written after a key was pressed"
    )


class ReplayIn(Body):
    """The session to replay, and its speed."""

    session_id: str = Field(max_length=200)
    speed: float = Field(1.0, ge=MIN_SPEED, le=MAX_SPEED)
    filter: str | None = Field(None, max_length=20, description="recompute with this filter; none: the service's")
    cell: str | None = Field(None, max_length=500, description="recompute with this bundled cell; none: the service's")
    estimates: Literal["recomputed", "recorded"] = "recomputed"


Stretch = Annotated[tuple[float, float], Field(strict=False)]  # JSON has no tuples


class ReplayControl(Body):
    """Only what is named changes."""

    paused: bool | None = None
    speed: float | None = Field(None, ge=MIN_SPEED, le=MAX_SPEED)
    seek_s: float | None = Field(None, ge=0, le=1e9)
    step: bool = Field(False, description="pause, and take one frame more")
    loop: Stretch | Literal["off"] | None = Field(None, description="play this stretch again and again, s")
    estimates: Literal["recomputed", "recorded"] | None = None


def _recording_id(recorder: RecorderPart) -> str | None:
    session = recorder.session
    return None if session is None else session.id


def _require_recording(catalogue: CataloguePart, recorder: RecorderPart, session_id: str) -> None:
    if _recording_id(recorder) != session_id:
        if (loss := recorder.file_loss(session_id)) is not None:
            raise Problem(507, "storage", loss)
        with catalogue.open(session_id):  # 404 where there is none
            raise Problem(409, "not-now", Message("not-being-recorded", session=session_id))


def _require_order(t_from: float | None, t_to: float | None) -> None:
    if t_from is not None and t_to is not None and t_to < t_from:
        raise invalid("to", t_to, Message("not-before-from", start=f"{t_from:.15g}"))


@router.get("/sessions", response_model=SessionsOut)
def sessions(
    catalogue: CataloguePart, recorder: RecorderPart, limit: LimitQuery = None, cursor: CursorQuery = None
) -> dict[str, Any]:
    """Sessions, newest first."""
    recording = _recording_id(recorder)
    infos, problems = catalogue.survey()
    shown, following = page_of(infos, lambda info: (info.started_wall_ns, info.id), limit, cursor)
    return {
        "sessions": [session_json(info, recording) for info in shown],
        "unreadable": [unreadable_json(problem) for problem in (problems if cursor is None else ())],
        "next_cursor": following,
    }


@router.post("/sessions", status_code=201, response_model=SessionOut)
def start(events: EventsPart, recorder: RecorderPart, user: UserDep, body: NewSession | None = None) -> dict[str, Any]:
    """Start recording; the session is in the list by now, unless the disk takes nothing."""
    info = recorder.start(body.name if body else None)
    events.note("info", "recording", Message("recording-started-by-hand"), user.name)
    with suppress(SessionError):  # a full disk: the recorder tries again, and its status says why
        recorder.flush()
    return session_json(info, info.id)


@router.get("/sessions/{session_id}", response_model=SessionDetailOut)
def session(session_id: str, catalogue: CataloguePart, recorder: RecorderPart) -> dict[str, Any]:
    """One session with its markers, events and configurations."""
    with catalogue.open(session_id) as file:
        return session_json(file.info, _recording_id(recorder)) | {
            "markers": [marker_json(marker) for marker in file.markers()],
            "events": [event_json(event) for event in file.events()],
            "configs": [{"time": c.t_wall_ns / 1e9, "why": c.why} for c in file.configs()],
            "signals": file.signal_names(),
        }


@router.post("/sessions/{session_id}/stop", response_model=StoppedOut)
def stop(
    session_id: str, events: EventsPart, recorder: RecorderPart, catalogue: CataloguePart, user: UserDep
) -> dict[str, Any]:
    """Stop recording."""
    _require_recording(catalogue, recorder, session_id)
    recorder.stop()
    with suppress(SessionError):  # a full disk: the file is closed as soon as there is room
        recorder.flush()
    events.note("info", "recording", Message("recording-stopped-by-hand"), user.name)
    if (loss := recorder.file_loss(session_id)) is not None:
        raise Problem(507, "storage", loss)
    return {"stopped": True}


@router.post("/sessions/{session_id}/split", status_code=201, response_model=SessionOut)
def split(
    session_id: str, events: EventsPart, recorder: RecorderPart, catalogue: CataloguePart, user: UserDep
) -> dict[str, Any]:
    """End the running session and go on in a new one without losing a frame."""
    _require_recording(catalogue, recorder, session_id)
    info = recorder.split()
    events.note("info", "recording", Message("recording-split-by-hand"), user.name)
    return session_json(info, info.id)


@router.post("/sessions/{session_id}/markers", status_code=201, response_model=MarkedOut)
def mark(
    session_id: str, body: NewMarker, recorder: RecorderPart, catalogue: CataloguePart, live: LivePart, user: UserDep
) -> dict[str, Any]:
    """Mark this instant of the running session; kind `lap` is the line crossed, which laps left counts with."""
    _require_recording(catalogue, recorder, session_id)
    recorder.marker(body.text, body.kind, user.name, body.ago_s)
    if body.kind in LAP_KINDS:
        live.mark_lap(body.ago_s)
    recorder.flush()
    return {"marked": True}


@router.get("/sessions/{session_id}/markers", response_model=MarkersOut)
def markers(
    session_id: str, catalogue: CataloguePart, limit: LimitQuery = None, cursor: CursorQuery = None
) -> dict[str, Any]:
    """The markers of a session, in the order in which they were made."""
    with catalogue.open(session_id) as file:
        shown, following = page_of(file.markers(), lambda marker: (marker.id, ""), limit, cursor, newest_first=False)
    return {"markers": [marker_json(marker) for marker in shown], "next_cursor": following}


@router.delete("/sessions/{session_id}", response_model=DeletedOut)
def delete(
    session_id: str, events: EventsPart, catalogue: CataloguePart, recorder: RecorderPart, user: UserDep
) -> dict[str, Any]:
    """Delete a session for ever."""
    if _recording_id(recorder) == session_id:
        raise Problem(409, "not-now", Message("stop-recording-first"))
    catalogue.delete(session_id)
    events.note("info", "session-deleted", Message("session-deleted", session=session_id), user.name)
    return {"deleted": True}


@router.get("/sessions/{session_id}/series", responses={200: {"model": SessionSeriesOut}})
def series(
    session_id: str,
    catalogue: CataloguePart,
    signal: Annotated[list[SignalName], Query(min_length=1, max_length=200)],
    t_from: From = None,
    t_to: To = None,
    points: Annotated[int, Query(ge=1, le=20000)] = 2000,
) -> Response:
    """Signals over a range, smallest and largest per point, so that no dip is lost; null is a gap."""
    _require_order(t_from, t_to)
    with catalogue.open(session_id) as file:
        filled = file.filled()
        try:
            samples = file.series(signal, t_from, t_to, points)
        except UnknownSignal as error:
            raise invalid("signal", error.name, error.reason) from error
    body = {
        "signals": {
            name: {"unit": s.unit, "time": s.time_s, "min": s.minimum, "max": s.maximum} for name, s in samples.items()
        },
        "gaps": sorted({gap for s in samples.values() for gap in s.gaps}),
        "filled": [span for span in filled if span[1] >= (t_from or 0) and span[0] <= (t_to or MAX_UNIX_S)],
    }
    return Response(orjson.dumps(body, option=orjson.OPT_SERIALIZE_NUMPY), media_type="application/json")


@router.get(
    "/sessions/{session_id}/export",
    response_class=FileResponse,
    responses={200: {"content": {form.media_type: {} for form in FORMATS.values()}, "description": "the file"}},
)
def download(
    session_id: str,
    catalogue: CataloguePart,
    workers: WorkersPart,
    export_format: ExportFormat = "csv",
    signal: Annotated[list[SignalName] | None, Query(max_length=2000)] = None,
    t_from: From = None,
    t_to: To = None,
    names: Annotated[Names, Query(description="v[36] (index), v_037 (number) or pack4_cell1_v (pack)")] = "index",
) -> FileResponse:
    """Signals of a range as a file; without `signal` all fast ones and the estimates."""
    _require_order(t_from, t_to)
    if export_format not in FORMATS:
        raise invalid("format", export_format, Message("one-of", choices=tuple(FORMATS)))
    with tempfile.NamedTemporaryFile(suffix=FORMATS[export_format].suffix, delete=False) as target:
        path = Path(target.name)
    try:
        source = catalogue.path(session_id)
        is_simulated = workers.run(EXPORT, export_at, source, path, export_format, signal, t_from, t_to, names)
    except UnknownSignal as error:
        path.unlink(missing_ok=True)
        raise invalid("signal", error.name, error.reason) from error
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    name = session_id + ("-simulated" if is_simulated else "") + FORMATS[export_format].suffix
    return FileResponse(
        str(path),
        filename=name,
        media_type=FORMATS[export_format].media_type,
        background=BackgroundTask(path.unlink, missing_ok=True),
    )


@router.get(
    "/sessions/{session_id}/file",
    response_class=FileResponse,
    responses={200: {"content": {SQLITE: {}}, "description": "the file"}},
)
def file(session_id: str, catalogue: CataloguePart) -> FileResponse:
    """The session itself, one SQLite file; of the one being recorded all up to now.

    With its SHA-256 as ETag and Repr-Digest, and in ranges, so that a download that was cut off goes on.
    """
    closed = catalogue.closed_file(session_id)
    if closed is not None:
        path, digest = closed
        return FileResponse(str(path), filename=path.name, media_type=SQLITE, headers=_digest_headers(digest))
    with tempfile.NamedTemporaryFile(suffix=".sqlite", delete=False) as target:
        path = Path(target.name)
    try:
        with catalogue.open(session_id) as session_file:
            session_file.copy_to(path)
    except SessionError:
        path.unlink(missing_ok=True)
        raise
    return FileResponse(
        str(path),
        filename=f"{session_id}.sqlite",
        headers=_digest_headers(sha256(path)),
        media_type=SQLITE,
        background=BackgroundTask(path.unlink, missing_ok=True),
    )


def _digest_headers(digest: bytes) -> dict[str, str]:
    return {"ETag": f'"{digest.hex()}"', "Repr-Digest": f"sha-256=:{base64.b64encode(digest).decode()}:"}


@router.get("/replay", response_model=ReplayChoicesOut)
def replay_state(replay: ReplayPart, pipelines: PipelinesPart) -> dict[str, Any]:
    """Return the position of the replay, and the filters and cells that can recompute the estimates."""
    return {"replay": replay.state(), "filters": FILTERS, "cells": [SESSION_CELL, *pipelines.cells]}


@router.post("/replay", response_model=ReplayStateOut)
def replay(
    body: ReplayIn, replay: ReplayPart, events: EventsPart, catalogue: CataloguePart, user: UserDep
) -> dict[str, Any]:
    """Show a session instead of the live source; recording goes on."""
    path = catalogue.path(body.session_id)
    replay.start(path, ReplayOptions(body.speed, body.filter, body.cell, body.estimates))
    events.note("info", "replay", Message("replay-started", session=body.session_id), user.name)
    return {"replay": replay.state()}


@router.post("/replay/control", response_model=ReplayStateOut)
def control(body: ReplayControl, replay: ReplayPart, user: UserDep) -> dict[str, Any]:
    """Pause, speed, seek, step, loop, which estimates are shown."""
    replay.control(
        paused=body.paused,
        speed=body.speed,
        seek_s=body.seek_s,
        step=body.step,
        loop=body.loop,
        estimates=body.estimates,
    )
    return {"replay": replay.state()}


@router.post("/replay/stop", response_model=ReplayStateOut)
def stop_replay(replay: ReplayPart, user: UserDep) -> dict[str, Any]:
    """Back to the live source."""
    replay.stop()
    return {"replay": None}
