"""The race: laps to go with the energy that each may take, and what the driver is shown of it on CAN.

What the driver is shown changes what the car does, so it is in the signed log; a full disk keeps no word from a driver.
"""

from typing import Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.api.web.dependencies import DriverDisplayPart, EventsPart, LinksPart, LivePart, SignedPart, UserDep
from app.api.web.problems import Problem, invalid
from app.api.web.request_body import Body
from app.errors import NotNow
from app.estimation.prediction.energy_target import RacePlan
from app.sources.links.driver_display import DriverFrame, DriverMessage
from app.words import Message, Quantity, RenderedMessage, rendered_or_none
from firmware_protocol.memory_map import CAN_ID_EXTENDED

router = APIRouter(tags=["race"])
MAX_LAPS = 500
MAX_RESERVE = 0.5


class RacePlanOut(BaseModel):
    """The race plan; what a lap may take is in the snapshot."""

    laps_to_go: int
    reserve_soc: float


class DriverFrameOut(BaseModel):
    """A frame that is sent."""

    id: int
    extended: bool
    length: int
    start_byte: int
    byte_order: Literal["little", "big"]
    period_ms: int


class DriverCanOut(BaseModel):
    """The two frames, null where not sent; what stands in them now."""

    target: DriverFrameOut | None
    message: DriverFrameOut | None
    shown: DriverMessage
    target_wh: float | None
    sent: int
    error: RenderedMessage | None
    block_reason: RenderedMessage | None


class RacePlanIn(Body):
    """Laps that are still to be driven, the present one included, and the SOC of the lowest cell at the end."""

    laps_to_go: int = Field(ge=1, le=MAX_LAPS)
    reserve_soc: float = Field(0.05, ge=0, le=MAX_RESERVE)


class DriverFrameIn(Body):
    """One CAN frame: its id, its length, and where in it the value stands. Bytes that hold no value are 0."""

    id: int = Field(ge=0, lt=1 << 29)
    extended: bool = False
    length: int = Field(8, ge=1, le=8)
    start_byte: int = Field(0, ge=0, le=7)
    byte_order: Literal["little", "big"] = "little"
    period_ms: int = Field(200, ge=100, le=10_000)

    def frame(self, field: str, value_bytes: int) -> DriverFrame:
        """Return the frame as the service has it."""
        if not self.extended and self.id > 0x7FF:
            raise invalid(f"{field}.id", self.id, Message("short-id-ends"))
        if self.start_byte + value_bytes > self.length:
            raise invalid(
                f"{field}.length", self.length, Message("input-at-least", limit=self.start_byte + value_bytes)
            )
        wire_id = self.id | (CAN_ID_EXTENDED if self.extended else 0)
        return DriverFrame(wire_id, self.length, self.start_byte, self.byte_order, self.period_ms)


class DriverCanIn(Body):
    """The frames to send; null: not sent."""

    target: DriverFrameIn | None = None
    message: DriverFrameIn | None = None


class DriverMessageIn(Body):
    """The message to the driver."""

    message: DriverMessage


@router.put("/race-plan", response_model=RacePlanOut)
def plan(body: RacePlanIn, live: LivePart, events: EventsPart, signed: SignedPart, user: UserDep) -> dict[str, Any]:
    """Say how many laps are to go: `prediction.target` of the snapshot tells from then on what a lap may take."""
    what = f"race plan: {body.laps_to_go} laps, {100 * body.reserve_soc:g} % at the end"
    with signed.signed(user.name, "transmit", what, is_needed=True):
        live.set_plan(RacePlan(body.laps_to_go, body.reserve_soc))
    reserve = Quantity(100 * body.reserve_soc, "%")
    events.note("info", "race-plan", Message("race-plan", n=body.laps_to_go, reserve=reserve), user.name)
    return body.model_dump()


@router.delete("/race-plan", status_code=204)
def end_plan(live: LivePart, events: EventsPart, signed: SignedPart, user: UserDep) -> None:
    """No laps are to go: no target."""
    with signed.signed(user.name, "transmit", "race plan: none", is_needed=True):
        live.set_plan(None)
    events.note("info", "race-plan", Message("race-plan-ended"), user.name)


@router.get("/driver-can", response_model=DriverCanOut)
def driver_can(display: DriverDisplayPart, links: LinksPart) -> dict[str, Any]:
    """Return the frames sent to the driver's display, their present values, and why none can be sent."""
    block_reason = None if links.can is not None else Message("no-can")
    return {
        "target": _frame_json(display.target),
        "message": _frame_json(display.message),
        "shown": display.shown,
        "target_wh": display.target_wh,
        "sent": display.sent,
        "error": rendered_or_none(display.error),
        "block_reason": rendered_or_none(block_reason),
    }


@router.put("/driver-can", response_model=DriverCanOut)
def map_driver_can(
    body: DriverCanIn,
    display: DriverDisplayPart,
    links: LinksPart,
    events: EventsPart,
    signed: SignedPart,
    user: UserDep,
) -> dict[str, Any]:
    """Send these frames from now on. An id that anybody else on the bus sends or listens to is refused."""
    target = None if body.target is None else body.target.frame("target", 2)
    message = None if body.message is None else body.message.frame("message", 1)
    ids = tuple(f"{frame.can_id & ~CAN_ID_EXTENDED:#x}" for frame in (target, message) if frame is not None)
    with signed.signed(user.name, "transmit", f"driver's display: {', '.join(ids) or 'nothing'}"):
        _put(display, target, message, user.name)
    text = Message("driver-can-on", ids=ids) if ids else Message("driver-can-off")
    events.note("info", "driver-can", text, user.name)
    return driver_can(display, links)


@router.post("/driver-can/message", response_model=DriverCanOut)
def message_driver(
    body: DriverMessageIn,
    display: DriverDisplayPart,
    links: LinksPart,
    events: EventsPart,
    signed: SignedPart,
    user: UserDep,
) -> dict[str, Any]:
    """Tell the driver to go, to slow down or to come in; `none` takes it back."""
    if display.message is None:
        raise Problem(409, "not-now", Message("driver-message-not-mapped"))
    with signed.signed(user.name, "transmit", f"driver's message: {body.message}", is_needed=True):
        display.show(body.message)
    events.note("info", "driver-message", Message("driver-message", message=body.message), user.name)
    return driver_can(display, links)


def _put(display: DriverDisplayPart, target: DriverFrame | None, message: DriverFrame | None, who: str | None) -> None:
    try:
        display.send(target, message, who or "")
    except NotNow as error:
        raise Problem(409, "id-in-use", error.message) from error


def _frame_json(frame: DriverFrame | None) -> dict[str, Any] | None:
    if frame is None:
        return None
    return {
        "id": frame.can_id & ~CAN_ID_EXTENDED,
        "extended": bool(frame.can_id & CAN_ID_EXTENDED),
        "length": frame.length,
        "start_byte": frame.start_byte,
        "byte_order": frame.byte_order,
        "period_ms": frame.period_ms,
    }
