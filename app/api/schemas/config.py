"""Configuration, memory map and CAN tables."""

from typing import Any, Literal

from pydantic import BaseModel, Field

from app.api.schemas.page import PageOut
from app.api.schemas.snapshot import Number
from app.words import RenderedMessage

RawValue = int | list[int] | list[list[int]]


class StructFieldOut(BaseModel):
    """A field of the master's struct."""

    name: str
    offset: int
    type: Literal["u8", "i8", "u16", "i16", "u32", "i32"]
    count: int
    shape: list[int]
    unit: str
    scale: float
    meaning: str


class SchemaFieldOut(StructFieldOut):
    """A field of the configuration; limits and default are raw counts."""

    minimum: int | None
    maximum: int | None
    default: int | list[int] | None
    range: str
    group: str
    live: bool  # may be changed while the car drives or charges


class SchemaOut(BaseModel):
    """The memory map."""

    map_hash: str
    fields: list[SchemaFieldOut]
    groups: list[str]
    struct: list[StructFieldOut]


class ConfigIssueOut(BaseModel):
    """A finding of the rules about one element: errors block, warnings need a reason unless they stand already.

    A notice is for people: the page asks for a reason, a program may write without one.
    """

    level: Literal["error", "warning", "notice"]
    code: str
    standing: bool
    field: str
    element: int | None
    value: float
    limit: RenderedMessage
    why: RenderedMessage
    message: RenderedMessage


class ConfigOut(BaseModel):
    """The configuration in force, in units and in raw counts."""

    hash: str
    stored_hash: str | None
    age_s: Number
    values: dict[str, Any]
    raw: dict[str, RawValue]
    findings: list[ConfigIssueOut]
    allowed: dict[str, tuple[int, int]] = Field(
        description="lowest and highest raw count of a field that is written without an error, given the other values"
    )


class StoredConfigOut(BaseModel):
    """The configuration in the EEPROM."""

    hash: str
    values: dict[str, Any]
    raw: dict[str, RawValue]
    counter: int


class DifferenceOut(BaseModel):
    """One element that changes, in its unit."""

    field: str
    element: int | None
    from_: int | float = Field(alias="from")  # whole where the unit has no decimals
    to: int | float
    unit: str
    offset: int


class WriteResultOut(BaseModel):
    """The result of a write, or of a dry run."""

    hash: str
    written: bool
    dry_run: bool
    verified: bool
    difference: list[DifferenceOut]
    warnings: list[ConfigIssueOut]
    block_reason: RenderedMessage | None  # why it would be refused now


class StoreResultOut(BaseModel):
    """The EEPROM, read back."""

    stored_hash: str
    verified: Literal[True]
    counter: int


class LoadResultOut(BaseModel):
    """The configuration in force after the stored one was loaded."""

    hash: str


class SourceOut(BaseModel):
    """A configuration by the name of its source."""

    hash: str
    values: dict[str, Any]
    raw: dict[str, RawValue]
    findings: list[ConfigIssueOut]


class SavedProfileOut(BaseModel):
    """A profile, without its values."""

    name: str
    version: int
    comment: str
    saved_by: str
    saved_at: str
    hash: str
    converted_from: str | None = Field(description="hash of the memory map that its values were of; null: the present")


class ProfileOut(SavedProfileOut):
    """The newest version of a profile, and the numbers of all."""

    versions: list[int]


class ProfilesOut(BaseModel):
    """All profiles, by name; `broken` are files that are none any more."""

    profiles: list[ProfileOut]
    broken: list[str]


class CheckedProfileOut(SavedProfileOut):
    """A profile that was saved, and what the rules say about it."""

    findings: list[ConfigIssueOut]


class ComparedOut(BaseModel):
    """One side of a comparison."""

    source: str
    hash: str


class ComparisonOut(BaseModel):
    """The differences from `a` to `b`."""

    a: ComparedOut
    b: ComparedOut
    difference: list[DifferenceOut]


class ConfigRecordOut(BaseModel):
    """One write in the history; `genuine` is false where its signature, or one before it, is not right."""

    number: int
    time: float
    who: str
    action: Literal["write", "load", "store", "rollback"]
    source: str
    reason: str
    result: str
    from_hash: str | None
    to_hash: str | None
    difference: list[DifferenceOut]
    genuine: bool


class ConfigHistoryOut(PageOut):
    """Records, newest first."""

    records: list[ConfigRecordOut]


class CanSignalOut(BaseModel):
    """A field of the struct inside a message."""

    name: str
    start_byte: int
    first_bit: int
    n_bits: int
    length: int
    byte_order: Literal["little", "big"]
    is_big_endian: bool
    is_signed: bool
    scale: float
    unit: str
    meaning: str
    is_cut: bool


class CanMessageOut(BaseModel):
    """An entry of the transmit or receive table; `bytes` are offsets into the struct, 65535 = unused."""

    index: int
    enabled: bool
    id: int
    extended: bool
    length: int
    bytes: list[int]
    name: str
    signals: list[CanSignalOut]


class CanTxOut(CanMessageOut):
    """A message that the master sends."""

    period_ms: int
    latency_ms: Number  # at worst, from due to sent; null: not cyclic, or the bus is too busy for it
    load: float


class CanRxOut(CanMessageOut):
    """A message that the master receives; `active` null before the master reports it."""

    timeout_ms: int
    response: int | None
    charges: bool
    active: bool | None


class CanTablesOut(BaseModel):
    """Both tables; `assumed` while only the defaults are known."""

    bit_rate: int
    bus_load: float
    tx: list[CanTxOut]
    rx: list[CanRxOut]
    hash: str
    assumed: bool


class CanFrameOut(BaseModel):
    """A frame on the bus; `data` in hexadecimal."""

    time: float
    id: int
    extended: bool
    direction: Literal["rx", "tx"]
    data: str
    name: str | None


class CanSeenOut(CanFrameOut):
    """The latest frame of an id; `changed` has a bit for each byte."""

    count: int
    period_s: Number
    changed: int


class CanTraceOut(BaseModel):
    """The newest frames, and the latest of every id."""

    frames: list[CanFrameOut]
    by_id: list[CanSeenOut]
