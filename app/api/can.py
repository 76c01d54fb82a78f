"""CAN: the tables in the configuration, the DBC made of them, what is heard."""

from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Response
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from app.api.can_json import tables_json, traced_json
from app.api.config import Wish, require_match, run_write
from app.api.deps import RuntimeDep, UserDep
from app.api.problems import invalid
from app.api.schemas.config import CanTablesOut, CanTraceOut, WriteResultOut
from firmware_protocol.can_tables import RxMessage, TxMessage, bit_rate, with_rx_messages, with_tx_messages
from firmware_protocol.config_image import default_image, image_hash, with_raw
from firmware_protocol.dbc import to_dbc
from firmware_protocol.memory_map import CAN_DATA_BYTES

router = APIRouter(prefix="/can", tags=["can"])
Offsets = Annotated[list[int], Field(min_length=CAN_DATA_BYTES, max_length=CAN_DATA_BYTES)]


class TxIn(BaseModel):
    """A message that the master sends."""

    model_config = ConfigDict(extra="ignore")
    index: int = Field(ge=0, le=7)
    enabled: bool
    id: int = Field(ge=0, lt=1 << 29)
    extended: bool
    period_ms: int = Field(ge=0, le=60000)
    length: int = Field(ge=0, le=8)
    bytes: Offsets

    def message(self) -> TxMessage:
        """As the protocol has it."""
        return TxMessage(
            self.index, self.enabled, self.id, self.extended, self.period_ms, self.length, tuple(self.bytes)
        )


class RxIn(BaseModel):
    """A message that the master listens for."""

    model_config = ConfigDict(extra="ignore")
    index: int = Field(ge=0, le=7)
    enabled: bool
    id: int = Field(ge=0, lt=1 << 29)
    extended: bool
    timeout_ms: int = Field(ge=0, le=60000)
    length: int = Field(ge=0, le=8)
    bytes: Offsets
    response: int | None = Field(None, ge=0, le=7)

    def message(self) -> RxMessage:
        """As the protocol has it."""
        return RxMessage(
            self.index,
            self.enabled,
            self.id,
            self.extended,
            self.timeout_ms,
            self.length,
            tuple(self.bytes),
            self.response,
        )


class TablesIn(BaseModel):
    """Messages to change; those not named stay."""

    tx: list[TxIn] = []
    rx: list[RxIn] = []
    bit_rate: int | None = None
    reason: str = Field("", max_length=500)

    def put_into(self, image: bytes) -> bytes:
        """Return the image with these messages."""
        image = with_tx_messages(image, [m.message() for m in self.tx])
        image = with_rx_messages(image, [m.message() for m in self.rx])
        if self.bit_rate is not None:
            image = with_raw(image, "can_brp", _prescaler(self.bit_rate))
        return image


def _prescaler(wanted: int) -> int:
    for can_brp in range(3, 256):
        if bit_rate(can_brp) == wanted:
            return can_brp
    rates = ", ".join(str(bit_rate(brp)) for brp in (3, 7, 15, 31))
    raise invalid("bit_rate", wanted, f"32 MHz / ((n + 1) 8), for example {rates}")


@router.get("", response_model=CanTablesOut)
def read(runtime: RuntimeDep, response: Response) -> dict[str, Any]:
    """The tables in force, with the names of what their bytes are; `assumed` while only the defaults are known."""
    in_force = runtime.config_in_force()
    image = in_force or default_image()
    response.headers["ETag"] = f'"{image_hash(image)}"'
    return tables_json(image, runtime.can_rx_active()) | {"hash": image_hash(image), "assumed": in_force is None}


@router.put("", responses={200: {"model": WriteResultOut}})
async def write(
    tables: TablesIn,
    runtime: RuntimeDep,
    user: UserDep,
    if_match: Annotated[str | None, Header()] = None,
    dry_run: bool = False,
) -> Response:
    """Write messages into the configuration in force and read it back."""
    wish = Wish(tables.put_into, tables.reason, "CAN tables")
    return await run_write(runtime, user.name, wish, require_match(if_match), dry_run=dry_run)


@router.get("/dbc", response_class=PlainTextResponse)
def dbc(runtime: RuntimeDep) -> Response:
    """The tables in force as a DBC file."""
    text = to_dbc(runtime.config_in_force() or default_image())
    headers = {"Content-Disposition": 'attachment; filename="voltwall.dbc"'}
    return Response(text, media_type="text/plain; charset=utf-8", headers=headers)


@router.get("/trace", response_model=CanTraceOut)
async def trace(runtime: RuntimeDep, limit: Annotated[int, Query(ge=1, le=2000)] = 200) -> dict[str, Any]:
    """The last frames, and the latest of every id."""
    return await run_in_threadpool(traced_json, runtime.trace, limit, runtime.config_in_force() or default_image())
