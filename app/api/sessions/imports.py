"""Recordings of other systems: uploaded, mapped, made into sessions."""

import asyncio
from dataclasses import asdict
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request
from pydantic import Field

from app.api.schemas.sessions import ImportsOut, ImportStateOut, PreviewOut, UploadOut
from app.api.web.dependencies import EventsPart, ImportsPart, UserDep
from app.api.web.request_body import Body
from app.sessions.transfer.import_jobs import ImportState
from app.sources.recordings.import_mapping import ImportMapping, mapping_of
from app.words import Message, rendered, rendered_or_none

BINARY = {"type": "string", "format": "binary"}
Quantity = Literal["time", "current", "voltage", "temperature", "soc"]
router = APIRouter(tags=["sessions"])


Name = Annotated[str, Field(max_length=60)]


class ReadingIn(Body):
    """The reading of an upload: fields of a profile, or the name of a kept one."""

    profile: dict[Name, Annotated[str, Field(max_length=5000)] | float | bool] = Field(
        default_factory=dict, max_length=40
    )
    profile_name: str | None = Field(None, max_length=60)
    dbc: int | None = Field(None, description="the upload that says what the CAN frames mean")


class PreviewIn(ReadingIn):
    """The reading of an upload, and the quantities whose units the file determines."""

    pick_units: list[Quantity] = Field(
        default_factory=list, max_length=5, description="take their units from the names and values of the columns"
    )


class ImportIn(ReadingIn):
    """The reading of an upload, and the session to make of it."""

    save_as: str | None = Field(None, max_length=60, description="keep the profile under this name")
    battery: str | None = Field(None, max_length=60, description="a bundled battery: whose frames, or whose cells")
    battery_uploads: list[int] = Field(
        default_factory=list,
        max_length=8,
        description="instead: uploads of a battery's profile, then of what it includes and its DBCs",
    )
    name: str = Field("", max_length=120, description="what to call the session")
    started_unix_s: float | None = Field(None, ge=0, description="when it began, if the file has no date")


def _state(imports: ImportsPart) -> dict[str, Any] | None:
    return None if imports.state is None else _state_json(imports.state)


def _state_json(state: ImportState) -> dict[str, Any]:
    return asdict(state) | {"notes": [*map(rendered, state.notes)], "error": rendered_or_none(state.error)}


@router.get("/imports", response_model=ImportsOut)
def imports(imports: ImportsPart) -> dict[str, Any]:
    """Return the progress of the last import, and the profiles that are kept."""
    store = imports.mappings
    return {"last": _state(imports), "profiles": store.names()}


@router.post(
    "/imports",
    status_code=201,
    response_model=UploadOut,
    openapi_extra={"requestBody": {"content": {"application/octet-stream": {"schema": BINARY}}, "required": True}},
)
async def upload(
    request: Request, imports: ImportsPart, user: UserDep, filename: Annotated[str, Query(min_length=1, max_length=200)]
) -> dict[str, Any]:
    """Take a file: CSV, Parquet, a CAN log, a battery's profile, or a DBC; says what is in it and guesses a profile."""
    number, path = imports.new_path(filename)
    try:
        with path.open("wb") as file:
            async for piece in request.stream():
                file.write(piece)
    except OSError as error:
        imports.discard(path)
        raise OSError(error.errno, error.strerror, str(path)) from error
    except BaseException:
        imports.discard(path)
        raise
    inspected = await asyncio.to_thread(imports.inspect, number, path)
    return {
        "id": inspected.id,
        "filename": inspected.filename,
        "is_can": inspected.is_can,
        "columns": list(inspected.columns),
        "guessed": None if inspected.guessed is None else asdict(inspected.guessed),
    }


def _mapping(body: ReadingIn, imports: ImportsPart) -> ImportMapping:
    mapping = imports.mappings.load(body.profile_name) if body.profile_name else ImportMapping()
    return mapping_of({**asdict(mapping), **body.profile}) if body.profile else mapping


@router.post("/imports/{upload_id}/preview", response_model=PreviewOut)
def preview(upload_id: int, body: PreviewIn, imports: ImportsPart, user: UserDep) -> dict[str, Any]:
    """Say what is in an upload, and what its first rows become; nothing is imported."""
    table = imports.preview(upload_id, _mapping(body, imports), body.pick_units, dbc=body.dbc)
    rows = table.understood
    understood = None if rows is None else asdict(rows) | {"notes": [*map(rendered, rows.notes)]}
    return asdict(table) | {"understood": understood, "error": rendered_or_none(table.error)}


@router.post("/imports/{upload_id}", status_code=202, response_model=ImportStateOut)
def start(upload_id: int, body: ImportIn, events: EventsPart, imports: ImportsPart, user: UserDep) -> dict[str, Any]:
    """Make a session of an upload, estimated by the service's filter and cell."""
    mapping = _mapping(body, imports)
    state = imports.start(
        upload_id,
        mapping,
        dbc=body.dbc,
        name=body.name,
        started_unix_s=body.started_unix_s,
        battery=body.battery,
        battery_uploads=body.battery_uploads,
    )
    if body.save_as:
        imports.mappings.save(body.save_as, mapping)
    events.note("info", "import", Message("being-imported", filename=state.filename), user.name)
    return _state_json(state)
