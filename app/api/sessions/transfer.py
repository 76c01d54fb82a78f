"""Sessions from elsewhere: fetched from a recorder in the car; and, in the car, what such a service asks for."""

import hashlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import asdict
from itertools import islice
from typing import Annotated, Any, Literal

import orjson
from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field, SecretStr

from app.api.schemas.sessions import FetchStateOut
from app.api.schemas.snapshot import Number
from app.api.web.dependencies import (
    CataloguePart,
    EventsPart,
    FetchesPart,
    FollowersPart,
    RecorderPart,
    SettingsPart,
    SignedPart,
    UserDep,
)
from app.api.web.request_body import Body
from app.sessions.storage.queries import StoredSession
from app.sessions.transfer.fetch import Remote
from app.sessions.transfer.fill import is_own
from app.sessions.transfer.follow import Order
from app.sessions.transfer.pieces import head_of, n_pieces, read_piece
from app.sessions.transfer.session_copy import SessionCopy
from app.words import Message, RenderedMessage, rendered, rendered_or_none

router = APIRouter(tags=["sessions"])


class RecorderFollowedOut(BaseModel):
    """A recorder whose sessions are copied; `last_contact_s` is the unix time of its last answer."""

    url: str
    is_reached: bool
    error: RenderedMessage | None
    last_contact_s: Number


class CopyOut(BaseModel):
    """A session that is not all here; `missing` are stretches of unix time, of `pieces` pieces of `piece_s` each."""

    id: str
    name: str
    started: float
    recording: bool
    piece_s: float
    pieces: int
    missing: list[tuple[float, float]]
    missing_s: float


class CopiesOut(BaseModel):
    """Newest first; what is all here is a session as any other. `order`: which missing pieces come first."""

    order: Literal["oldest", "newest"]
    recorders: list[RecorderFollowedOut]
    copies: list[CopyOut]


class OfferOut(BaseModel):
    """A session, and how many pieces of ten seconds of it are on the disk."""

    id: str
    started: float
    bytes: int
    recording: bool
    pieces: int


class OffersOut(BaseModel):
    """Newest first."""

    sessions: list[OfferOut]


class HeadOut(BaseModel):
    """A session without its rows; `battery_files` are names and base64, empty for the team's own battery."""

    id: str
    name: str
    voltwall: str
    map_hash: str
    metadata: dict[str, Any]
    start_mono_ns: int
    start_wall_ns: int
    end_mono_ns: int | None
    end_wall_ns: int | None
    closed: bool
    recording: bool
    pieces: int
    bytes: int
    frames: int
    can_frames: int
    cell_file: str | None
    battery_files: list[Annotated[list[str], Field(min_length=2, max_length=2)]]


class FetchIn(Body):
    """The remote service, and the sessions to fetch; without `sessions` all that are finished there and not here."""

    url: str = Field(max_length=200, description="the other service, as http://car.local:8000")
    label: str = Field("", max_length=41, description="what its sessions are called here, before their id")
    password: SecretStr | None = Field(None, description="its viewer's or engineer's")
    trust: str | None = Field(
        None,
        pattern=r"^[0-9A-Fa-f:]{64,95}$",
        description="SHA-256 of its certificate; without it what this service was started with (`--trust`)",
    )
    sessions: list[Annotated[str, Field(max_length=200)]] = Field(default_factory=list, max_length=1000)
    fill: bool = Field(True, description="fill gaps of the sessions recorded here from what was fetched")


class OrderIn(Body):
    """The missing pieces to fetch first."""

    order: Order


def _answer(state: Any) -> dict[str, Any]:
    if state is None:
        return {"fetch": None}
    sent = {"filled": [*map(rendered, state.filled)], "error": rendered_or_none(state.error)}
    return {"fetch": asdict(state) | sent}


@router.get("/fetch", response_model=FetchStateOut)
def fetch_state(fetches: FetchesPart) -> dict[str, Any]:
    """Return the progress of the last fetch; null before the first."""
    return _answer(fetches.state())


@router.post("/fetch", status_code=202, response_model=FetchStateOut)
def fetch(
    body: FetchIn,
    settings: SettingsPart,
    events: EventsPart,
    fetches: FetchesPart,
    signed: SignedPart,
    user: UserDep,
) -> dict[str, Any]:
    """Fetch sessions of another voltwall service; one that was cut off goes on where it stopped."""
    password = None if body.password is None else body.password.get_secret_value()
    remote = Remote(body.url, label=body.label, password=password, trust=body.trust or settings.trust)
    with _trusting(signed, user.name, remote.url, body.trust):
        state = fetches.start(remote, body.sessions, fill=body.fill)
    events.note("info", "fetch", Message("fetch-started", url=remote.url), user.name)
    return _answer(state)


def _trusting(signed: SignedPart, who: str, url: str, trust: str | None) -> AbstractContextManager[None]:
    """Keep which certificate somebody trusts beyond those of the service: a password may go there."""
    return nullcontext() if trust is None else signed.signed(who, "setup", f"trust {trust} for {url}")


@router.get("/copies", response_model=CopiesOut)
def copies(settings: SettingsPart, followers: FollowersPart) -> dict[str, Any]:
    """Sessions of the recorders that are followed (`--recorder`), and which stretches of them are not here yet."""
    return {
        "order": followers.order,
        "recorders": [asdict(state) | {"error": rendered_or_none(state.error)} for state in followers.states()],
        "copies": [copy.state() for copy in SessionCopy.all_in(settings.data / "sessions")],
    }


@router.put("/copies/order", response_model=CopiesOut)
def choose_order(
    body: OrderIn, settings: SettingsPart, followers: FollowersPart, events: EventsPart, user: UserDep
) -> dict[str, Any]:
    """Choose which of the missing pieces come first, until the service ends; then it is `--recorder-order` again."""
    followers.choose(body.order)
    message = Message("copies-newest-first") if body.order == "newest" else Message("copies-oldest-first")
    events.note("info", "copies-order", message, user.name)
    return copies(settings, followers)


@router.get("/pieces", response_model=OffersOut)
def offers(
    catalogue: CataloguePart, recorder: RecorderPart, newest: Annotated[int, Query(ge=1, le=1000)] = 20
) -> dict[str, Any]:
    """Return the newest sessions recorded here, with the number of pieces of ten seconds of each."""
    recording = None if recorder.session is None else recorder.session.id
    return {
        "sessions": [
            {
                "id": info.id,
                "started": info.started_wall_ns / 1e9,
                "bytes": info.size_bytes,
                "recording": info.id == recording,
                "pieces": n_pieces(info, is_recording=info.id == recording),
            }
            for info in islice(filter(is_own, catalogue.list()), newest)
        ]
    }


@router.get("/sessions/{session_id}/head", response_model=HeadOut)
def head(session_id: str, catalogue: CataloguePart, recorder: RecorderPart) -> dict[str, Any]:
    """Metadata of a session."""
    with catalogue.open(session_id) as session:
        is_recording = recorder.session is not None and recorder.session.id == session_id
        return head_of(session, session.info, is_recording=is_recording)


@router.get("/sessions/{session_id}/pieces", response_class=StreamingResponse)
def pieces(
    session_id: str,
    catalogue: CataloguePart,
    recorder: RecorderPart,
    first: Annotated[int, Query(ge=0, le=1_000_000)],
    count: Annotated[int, Query(ge=1, le=64)] = 1,
    descending: bool = False,
) -> StreamingResponse:
    """Pieces of a session behind each other: a line of JSON (`piece`, `bytes`, `sha256`), then so many bytes."""
    is_recording = recorder.session is not None and recorder.session.id == session_id
    with catalogue.open(session_id) as session:
        info = session.info
    there = n_pieces(info, is_recording=is_recording)
    wanted = range(first, first - count, -1) if descending else range(first, first + count)

    def body() -> Iterator[bytes]:
        for number in wanted:
            if 0 <= number < there:
                with catalogue.open(session_id) as session, closing(StoredSession(session.path)) as stored:
                    is_last = not is_recording and number == there - 1
                    piece = read_piece(session, stored, info, number, is_last=is_last)
                digest = hashlib.sha256(piece).hexdigest()
                yield orjson.dumps({"piece": number, "bytes": len(piece), "sha256": digest}) + b"\n" + piece

    return StreamingResponse(body(), media_type="application/octet-stream")
