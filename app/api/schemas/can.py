"""The CAN bus: monitor, import, transmission."""

from typing import Literal

from pydantic import BaseModel

from app.api.schemas.config import CanRxOut, CanTxOut
from app.api.schemas.snapshot import Number
from app.words import RenderedMessage


class CanValueOut(BaseModel):
    """A signal of a frame, decoded; `text` where the number stands for a word."""

    name: str
    value: float
    unit: str
    text: str | None


class CanIdOut(BaseModel):
    """One id on the bus, or in the tables and not seen; periods in milliseconds, `changed` a bit for each byte."""

    id: int
    extended: bool
    name: str | None
    direction: Literal["rx", "tx"] | None
    sender: Literal["master", "other", "voltwall"]
    count: int
    age_s: Number
    period_ms: Number
    configured_ms: Number
    late: bool
    data: str | None
    changed: int
    values: list[CanValueOut]


class DisagreementOut(BaseModel):
    """One value of which RS232 and CAN say two things."""

    name: str
    rs232: float
    can: float
    unit: str
    since: float


class CanBusOut(BaseModel):
    """The bus monitor."""

    ids: list[CanIdOut]
    bit_rate: int
    bit_rate_known: bool  # else it is a guess: neither the profile nor the bus tells it
    load: float  # bus load of recent frames, each at its worst-case length
    errors: int | None  # null: the adapter does not say
    tx_errors: int | None
    rx_errors: int | None
    bus_state: Literal["active", "warning", "passive", "off"] | None
    rs232_live: bool
    disagreements: list[DisagreementOut]


class ImportedTablesOut(BaseModel):
    """Tables made of a DBC: those in force with the file's messages in their places, and what did not fit."""

    tx: list[CanTxOut]
    rx: list[CanRxOut]
    notes: list[str]


class TransmitOut(BaseModel):
    """State of the frames to send: whether they may be sent, and which are, or were last."""

    allowed: bool
    block_reason: RenderedMessage | None
    running: bool
    what: str | None
    who: str | None
    sent: int
    total: int | None
    error: RenderedMessage | None
