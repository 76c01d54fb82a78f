"""The CAN bus: what is received against what is configured, its trace as a file, and frames sent onto it."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from pydantic import Field
from starlette.background import BackgroundTask
from starlette.responses import FileResponse

from app.api.configuration.routes import OCTETS
from app.api.encoding.can import bus_json
from app.api.schemas.can import CanBusOut, TransmitOut
from app.api.web.dependencies import (
    BatteryPart,
    CanTracePart,
    CataloguePart,
    ClockPart,
    EventsPart,
    InForcePart,
    LinksPart,
    LivePart,
    SignedPart,
    UserDep,
)
from app.api.web.problems import Problem
from app.api.web.request_body import Body
from app.sessions.export.can_log import LOG_FORMATS, write_items
from app.sources.links.can_bus import bit_rate_of
from app.sources.links.can_sender import Outgoing
from app.words import Message, rendered, rendered_or_none
from firmware_protocol.can_tables import tx_messages
from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import CAN_DATA_BYTES, CAN_ID_EXTENDED

router = APIRouter(prefix="/can", tags=["can"])
MAX_SIGNED = 1000  # characters of frames in the signed log
MAX_LIST = 64


class FrameIn(Body):
    """A frame to send: once, or every `period_ms`, `count` times (0: until it is stopped)."""

    id: int = Field(ge=0, lt=1 << 29)
    extended: bool = False
    data: str = Field("", pattern=r"^([0-9A-Fa-f]{2}){0,8}$", description="hexadecimal")
    period_ms: int | None = Field(None, ge=1, le=60000)
    count: int = Field(0, ge=0, le=1_000_000)

    def outgoing(self) -> Outgoing:
        """Return the frame as the sender takes it."""
        if not self.extended and self.id > 0x7FF:
            raise Problem(
                422,
                "invalid",
                Message("eleven-bit-id", id=f"{self.id:#x}"),
                errors=[
                    {
                        "field": "id",
                        "value": self.id,
                        "limit": rendered("0..0x7ff"),
                        "message": rendered(Message("short-id-ends")),
                    }
                ],
            )
        period_s = None if self.period_ms is None else self.period_ms / 1000
        wire_id = self.id | (CAN_ID_EXTENDED if self.extended else 0)
        return Outgoing(wire_id, bytes.fromhex(self.data), period_s, self.count)


class TransmitIn(Body):
    """A list to send."""

    frames: list[FrameIn] = Field(min_length=1, max_length=MAX_LIST)


class ReplayFramesIn(Body):
    """A recorded session's CAN frames, sent onto the bus in their own time."""

    session: str = Field(max_length=120)
    speed: float = Field(1.0, ge=0.1, le=100)


@router.get("/bus", response_model=CanBusOut)
def bus(
    trace: CanTracePart,
    in_force: InForcePart,
    live: LivePart,
    battery: BatteryPart,
    links: LinksPart,
    clock: ClockPart,
) -> dict[str, Any]:
    """Every id: name, period measured and configured, last bytes, signals; what is configured and never received."""
    if battery.dbc_mapping is not None:
        names = {can_id: message.name for can_id, message in battery.definitions.by_id().items()}
        known_bit_rate = battery.dbc_mapping.bit_rate or bit_rate_of(None if links.can is None else links.can.url)
        return bus_json(trace, None, live.snapshot, clock, names, known_bit_rate)
    if not battery.has_memory_map:
        return bus_json(trace, None, live.snapshot, clock, {}, None)
    return bus_json(trace, in_force.image() or default_image(), live.snapshot, clock)


@router.get("/trace/export", response_class=FileResponse)
def export(
    trace: CanTracePart,
    live: LivePart,
    export_format: Annotated[Literal["candump", "asc", "blf"], Query(alias="format")],
) -> Response:
    """The trace as it stands, for other CAN tools."""
    suffix, write = LOG_FORMATS[export_format]
    with tempfile.NamedTemporaryFile(suffix=suffix, delete=False) as file:
        path = Path(file.name)
    is_simulated = live.source == "simulator"
    write_items(write, path, trace.latest(None), is_simulated=is_simulated)
    name = f"voltwall-can{'-simulated' if is_simulated else ''}{suffix}"
    return FileResponse(path, filename=name, media_type=OCTETS, background=BackgroundTask(path.unlink, missing_ok=True))


def _require_may_transmit(links: LinksPart) -> None:
    if (reason := links.transmit_block_reason) is not None:
        raise Problem(409, "not-on-this-bus", reason)


def _ids_of_master(live: LivePart, in_force: InForcePart) -> set[int]:
    """What a master that is there sends itself: two senders of one id destroy each other's frames."""
    snapshot = live.snapshot
    if snapshot is None or all(link.state != "live" for _, link in snapshot.links.items()):
        return set()
    messages = [m for m in tx_messages(in_force.image() or default_image()) if m.length]
    return {m.can_id | (CAN_ID_EXTENDED if m.is_extended else 0) for m in messages}


def _status(links: LinksPart) -> dict[str, Any]:
    status, reason = links.can_sender.status, links.transmit_block_reason
    return {
        "allowed": reason is None,
        "running": links.can_sender.is_busy,
        "what": status.what,
        "who": status.who,
        "sent": status.sent,
        "total": status.total,
        "error": rendered_or_none(status.error),
        "block_reason": rendered_or_none(reason),
    }


@router.get("/transmit", response_model=TransmitOut)
def transmitting(links: LinksPart) -> dict[str, Any]:
    """Return whether frames may be sent, and which are being sent."""
    return _status(links)


@router.post("/transmit", response_model=TransmitOut)
def transmit(
    body: TransmitIn,
    events: EventsPart,
    signed: SignedPart,
    links: LinksPart,
    live: LivePart,
    in_force: InForcePart,
    user: UserDep,
) -> dict[str, Any]:
    """Send frames once, or a list with periods until it is done or stopped. Simulator or bench only."""
    _require_may_transmit(links)
    frames = [frame.outgoing() for frame in body.frames]
    if taken := sorted({f.can_id & ~CAN_ID_EXTENDED for f in frames if f.can_id in _ids_of_master(live, in_force)}):
        ids = tuple(f"{can_id:#x}" for can_id in taken)
        raise Problem(409, "id-in-use", Message("master-sends-id", ids=ids))
    ids = tuple(f"{frame.can_id & ~CAN_ID_EXTENDED:#x}" for frame in frames[:8])
    what = " ".join(f"{frame.can_id & ~CAN_ID_EXTENDED:x}#{frame.data.hex()}" for frame in frames)[:MAX_SIGNED]
    with signed.signed(user.name, "transmit", what):
        if all(frame.period_s is None for frame in frames):
            links.can_sender.once(frames)
        else:
            links.can_sender.start_list(frames, user.name)
    message = Message("can-sent", ids=ids) if len(frames) < 9 else Message("can-sent-more", ids=ids, n=len(frames) - 8)
    events.note("info", "can-transmit", message, user.name)
    return _status(links)


@router.post("/transmit/replay", response_model=TransmitOut)
def replay_frames(
    body: ReplayFramesIn,
    events: EventsPart,
    signed: SignedPart,
    links: LinksPart,
    catalogue: CataloguePart,
    live: LivePart,
    in_force: InForcePart,
    user: UserDep,
) -> dict[str, Any]:
    """Send a session's CAN frames again, but for the ids that a master on the bus sends itself."""
    _require_may_transmit(links)
    skipped = _ids_of_master(live, in_force)
    with catalogue.open(body.session) as session:
        frames = [f for f in session.can_frames() if f.can_id not in skipped and len(f.data) <= CAN_DATA_BYTES]
    if not frames:
        raise Problem(409, "nothing-to-send", Message("nothing-to-send"))
    start_ns = frames[0].t_mono_ns

    def timed() -> Iterator[tuple[float, int, bytes]]:
        for frame in frames:
            yield (frame.t_mono_ns - start_ns) / 1e9 / body.speed, frame.can_id, frame.data

    what = f"session {body.session}"
    with signed.signed(user.name, "transmit", what):
        links.can_sender.start_frames(what, timed(), len(frames), user.name)
    events.note("info", "can-replay", Message("can-sent-again", n=len(frames), session=body.session), user.name)
    return _status(links)


@router.delete("/transmit", response_model=TransmitOut)
def stop_transmitting(events: EventsPart, signed: SignedPart, links: LinksPart, user: UserDep) -> dict[str, Any]:
    """Stop what is being sent."""
    was_busy = links.can_sender.is_busy
    links.can_sender.stop()
    if was_busy:
        signed.note(user.name, "transmit", "stop")
        events.note("info", "can-transmit", Message("can-sending-stopped"), user.name)
    return _status(links)
