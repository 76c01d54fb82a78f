"""CAN: the tables in the configuration, the DBC made of them, what is received."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from app.api.configuration.routes import ExpectedHash, write_response
from app.api.encoding.can import measured_messages, message_names, tables_json, traced_json
from app.api.schemas.can import ImportedTablesOut
from app.api.schemas.config import CanTablesOut, CanTraceOut, WriteResultOut
from app.api.web.dependencies import (
    NEEDS_MASTER,
    BatteryPart,
    CanTracePart,
    ConfigurationPart,
    InForcePart,
    LivePart,
    UserDep,
    WorkersPart,
)
from app.api.web.problems import invalid
from app.api.web.request_body import Body
from app.configuration.safe_write import Draft
from app.sessions.worker import DEFINITIONS
from app.words import Message
from firmware_protocol.can_tables import (
    RxMessage,
    TxMessage,
    bit_rate,
    named_element,
    offsets_of,
)
from firmware_protocol.config_image import default_image, image_hash
from firmware_protocol.dbc import MASTER_NODE, to_dbc
from firmware_protocol.dbc_import import from_dbc, into_tables
from firmware_protocol.errors import DecodeError
from firmware_protocol.memory_map import BYTE_UNUSED, CAN_DATA_BYTES, N_CAN_MESSAGES

router = APIRouter(prefix="/can", tags=["can"])
_DBC_BODY = {"requestBody": {"required": True, "content": {"text/plain": {"schema": {"type": "string"}}}}}
_NEVER_READ = "The default tables: this master's configuration was never read."
Offsets = Annotated[list[int], Field(min_length=CAN_DATA_BYTES, max_length=CAN_DATA_BYTES)]


class SignalIn(BaseModel):
    """A value of the master's struct by its name, at a byte of the message."""

    model_config = ConfigDict(extra="ignore")
    name: str = Field(max_length=60, description="as v_tot, v[36], slave[3].cvr[5]")
    start_byte: int = Field(ge=0, lt=CAN_DATA_BYTES)
    byte_order: Literal["little", "big"] = "little"


class MessageIn(BaseModel):
    """Fields of a message of both tables; its bytes as offsets, or as signals by name with the rest unused."""

    model_config = ConfigDict(extra="ignore")
    index: int = Field(ge=0, le=7)
    enabled: bool
    id: int = Field(ge=0, lt=1 << 29)
    extended: bool
    length: int = Field(ge=0, le=8)
    bytes: Offsets | None = None
    pick: list[SignalIn] | None = Field(None, max_length=CAN_DATA_BYTES, description="instead of bytes")

    def offsets(self) -> tuple[int, ...]:
        """The offset of every byte."""
        if self.bytes is not None and self.pick is None:
            return tuple(self.bytes)
        if self.pick is None or self.bytes is not None:
            raise invalid("bytes", None, Message("bytes-or-pick"))
        row = [BYTE_UNUSED] * CAN_DATA_BYTES
        for signal in self.pick:
            offsets = offsets_of(*named_element(signal.name), is_big_endian=signal.byte_order == "big")
            end = signal.start_byte + len(offsets)
            if end > self.length:
                raise invalid("pick", signal.name, Message("pick-too-long", end=end, length=self.length))
            if any(offset != BYTE_UNUSED for offset in row[signal.start_byte : end]):
                raise invalid("pick", signal.name, Message("byte-taken", byte=signal.start_byte))
            row[signal.start_byte : end] = offsets
        return tuple(row)


class TxIn(MessageIn):
    """A message that the master sends."""

    period_ms: int = Field(ge=0, le=60000)

    def message(self) -> TxMessage:
        """Return the message as the protocol has it."""
        return TxMessage(self.index, self.enabled, self.id, self.extended, self.period_ms, self.length, self.offsets())


class RxIn(MessageIn):
    """A message that the master listens for."""

    timeout_ms: int = Field(ge=0, le=60000)
    response: int | None = Field(None, ge=0, le=7)
    charges: bool = Field(False, description="charging begins with it and ends with its silence")

    def message(self) -> RxMessage:
        """Return the message as the protocol has it."""
        return RxMessage(
            self.index,
            self.enabled,
            self.id,
            self.extended,
            self.timeout_ms,
            self.length,
            self.offsets(),
            self.response,
            self.charges,
        )


class TablesIn(Body):
    """Messages to change; those not named stay."""

    tx: list[TxIn] = Field(default_factory=list, max_length=N_CAN_MESSAGES)
    rx: list[RxIn] = Field(default_factory=list, max_length=N_CAN_MESSAGES)
    bit_rate: int | None = None
    reason: str = Field("", max_length=500)


def _prescaler(wanted: int) -> int:
    for can_brp in range(3, 256):
        if bit_rate(can_brp) == wanted:
            return can_brp
    rates = tuple(bit_rate(brp) for brp in (3, 7, 15, 31))
    raise invalid("bit_rate", wanted, Message("possible-bit-rates", rates=rates))


@router.get("", response_model=CanTablesOut, dependencies=[NEEDS_MASTER])
def read(trace: CanTracePart, in_force: InForcePart, live: LivePart, response: Response) -> dict[str, Any]:
    """The tables in force, with the names of what their bytes are; `assumed` while only the defaults are known."""
    active = in_force.image()
    image = active or default_image()
    response.headers["ETag"] = f'"{image_hash(image)}"'
    tables = tables_json(image, live.can_rx_active, measured_messages(trace))
    return tables | {"hash": image_hash(image), "assumed": active is None}


@router.put("", responses={200: {"model": WriteResultOut}}, dependencies=[NEEDS_MASTER])
def write(
    tables: TablesIn,
    configuration: ConfigurationPart,
    user: UserDep,
    expected: ExpectedHash,
    dry_run: bool = False,
) -> Response:
    """Write messages into the configuration in force and read it back."""
    draft = Draft(
        raw={} if tables.bit_rate is None else {"can_brp": _prescaler(tables.bit_rate)},
        can_sent=[message.message() for message in tables.tx],
        can_received=[message.message() for message in tables.rx],
        reason=tables.reason,
        source="CAN tables",
    )
    written = configuration.write(draft, expected, user.name, dry_run=dry_run)
    return write_response(configuration, written, dry_run=dry_run)


@router.get("/dbc", response_class=PlainTextResponse, dependencies=[NEEDS_MASTER])
def dbc(in_force: InForcePart) -> Response:
    """The tables in force as a DBC file; its comment says so where they are the defaults."""
    image = in_force.image()
    text = to_dbc(default_image(), _NEVER_READ) if image is None else to_dbc(image)
    headers = {"Content-Disposition": 'attachment; filename="voltwall.dbc"'}
    return Response(text, media_type="text/plain; charset=utf-8", headers=headers)


@router.post("/dbc", response_model=ImportedTablesOut, openapi_extra=_DBC_BODY, dependencies=[NEEDS_MASTER])
async def import_dbc(
    request: Request,
    in_force: InForcePart,
    workers: WorkersPart,
    node: Annotated[str, Query(max_length=64, pattern=r"^\w+$")] = MASTER_NODE,
) -> dict[str, Any]:
    """Return the tables in force with a DBC's messages in them, and what of it did not fit. Nothing is written.

    What `node` sends becomes tx, everything else rx; signals are found by the names that our own DBC gives them.
    """
    text = (await request.body()).decode(errors="replace")
    try:
        imported = await run_in_threadpool(workers.run, DEFINITIONS, from_dbc, text, node)
    except DecodeError as error:
        raise invalid("body", "DBC", str(error)) from error
    image, notes = into_tables(in_force.image() or default_image(), imported)
    tables = tables_json(image, None)
    return {"tx": tables["tx"], "rx": tables["rx"], "notes": list(notes)}


@router.get("/trace", response_model=CanTraceOut)
async def trace(
    trace: CanTracePart,
    in_force: InForcePart,
    battery: BatteryPart,
    limit: Annotated[int, Query(ge=1, le=2000)] = 200,
) -> dict[str, Any]:
    """The last frames, and the latest of every id, named by the tables in force or the battery's DBC."""
    if battery.has_memory_map:
        names = message_names(in_force.image() or default_image())
    else:
        names = {message.can_id: message.name for message in battery.definitions.messages}
    return await run_in_threadpool(traced_json, trace, limit, names)
