"""Frames of a battery on a serial line: where they begin and end, their checksum, which bytes carry which signal."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

ByteOrder = Literal["little", "big"]
Parity = Literal["none", "even", "odd"]
SIGNALS = {  # name in a profile -> kind of `Values`
    "cells.voltage": "voltage",
    "cells.temperature": "temperature",
    "cells.balancing": "balancing",
    "cells.resistance": "resistance",
    "current": "current",
    "pack.voltage": "pack_voltage",
    "soc": "soc",
    "charger.voltage": "charger_voltage",
    "charger.current": "charger_current",
    "state.closed": "state.closed",
    "state.precharge": "state.precharge",
    "state.fault": "state.fault",
    "state.charging": "state.charging",
    "state.balancing": "state.balancing",
}
PLAUSIBLE = {  # V, degC, ohm, A, a fraction of 1: beyond it no frame without a checksum is one
    "voltage": (-0.5, 10.0),
    "temperature": (-60.0, 200.0),
    "resistance": (0.0, 1.0),
    "current": (-5000.0, 5000.0),
    "pack_voltage": (-1.0, 2000.0),
    "soc": (-0.5, 1.5),
    "charger_voltage": (-1.0, 2000.0),
    "charger_current": (-1000.0, 1000.0),
}
TYPES = {
    "u8": "u1",
    "i8": "i1",
    "u16": "u2",
    "i16": "i2",
    "u32": "u4",
    "i32": "i4",
    "u64": "u8",
    "i64": "i8",
    "f32": "f4",
    "f64": "f8",
    "sm16": "u2",
}  # numpy's names
SIGN_AND_MAGNITUDE = "sm16"  # the highest bit is the sign
LONGEST_FRAME = 16_384  # bytes; of a line characters
Header = tuple[int | None, ...]  # None: any byte


@dataclass(frozen=True, slots=True)
class Port:
    """Settings of the port, and what is sent over it."""

    baud: int = 115_200
    parity: Parity = "none"
    data_bits: int = 8
    stop_bits: float = 1.0
    start: bytes = b""  # when it opens, and while the line is silent
    stop: bytes = b""  # before it closes


@dataclass(frozen=True, slots=True)
class Checksum:
    """Over `first` up to `end` exclusive, at `at`; negative counts from the end of the frame."""

    kind: str
    first: int
    end: int
    at: int
    byte_order: ByteOrder


@dataclass(frozen=True, slots=True)
class LengthAt:
    """Length of the frame = the number at `offset` + `adds`."""

    offset: int
    size: int
    adds: int
    byte_order: ByteOrder


@dataclass(frozen=True, slots=True)
class IndexAt:
    """Number of the frame among those that make one sample; its first value is that of (number - base) * count."""

    base: int
    at: int = 0
    type: str = "u8"
    byte_order: ByteOrder = "little"
    column: int | None = None  # column of a line
    group: str = ""


@dataclass(frozen=True, slots=True)
class ChargingAt:
    """A number in the frame that says whether a current without a sign charges: one of `equals`, or a bit of `mask`."""

    at: int
    type: str
    equals: tuple[int, ...]
    mask: int
    byte_order: ByteOrder


@dataclass(frozen=True, slots=True)
class SerialField:
    """Values of one signal in a frame or line: value = raw * scale + offset."""

    name: str
    kind: str  # kind of `Values`
    type: str = "u16"  # a key of TYPES
    at: int = 0  # byte of the first value; negative counts from the end
    count: int = 1
    stride: int = 0  # bytes from one value to the next; 0: they follow each other
    byte_order: ByteOrder = "little"
    bits: bool = False  # each value is a mask, lowest bit first, of which `count` bits are values
    index: IndexAt | None = None
    charging: ChargingAt | None = None
    columns: tuple[int, int] | None = None  # columns of a line: first and last, from 0
    group: str = ""  # group of a line's pattern
    begin: str = ""  # text before the number in its column
    end: str = ""  # text behind it
    base: int = 10  # base of a line's numbers: 10 or 16
    is_signed: bool = False  # hex: two's complement
    first: int = 0  # cell or sensor, from 0, of the first value
    scale: float = 1.0
    offset: float = 0.0
    charge_is_positive: bool = False
    invalid: tuple[int, ...] = ()
    valid_range: tuple[float, float] | None = None
    equals: tuple[int, ...] = ()
    mask: int = 0
    max_age_s: float | None = None
    line: int | None = None  # line number in the profile


@dataclass(frozen=True, slots=True)
class SerialFrame:
    """A binary frame."""

    name: str
    header: Header = ()
    length: int | None = None  # bytes of the whole frame
    length_at: LengthAt | None = None
    gap_s: float | None = None  # silence before a frame without a header
    end: bytes = b""
    checksum: Checksum | None = None
    poll: bytes = b""
    poll_s: float = 1.0
    fields: tuple[SerialField, ...] = ()
    line: int | None = None


@dataclass(frozen=True, slots=True)
class SerialLine:
    """A frame in ASCII, up to a line's end, or from `begin` to `end`."""

    name: str
    separator: str = ","
    pattern: str = ""  # with named groups
    begin: str = ""
    end: str = ""
    is_hex: bool = False  # bytes in hex, which fields count from behind `begin`
    checksum: Checksum | None = None  # over characters from `begin` on, in hex digits
    poll: bytes = b""
    poll_s: float = 1.0
    fields: tuple[SerialField, ...] = ()
    row: int | None = None  # line number in the profile


@dataclass(frozen=True, slots=True)
class SerialMapping:
    """A battery on a serial line."""

    port: Port = field(default_factory=Port)
    frames: tuple[SerialFrame, ...] = ()
    lines: tuple[SerialLine, ...] = ()
    period_s: float = 0.1  # between two measurements

    @property
    def has_checksum(self) -> bool:
        """True where every frame or line has one."""
        return all(part.checksum is not None for part in self.parts)

    @property
    def parts(self) -> tuple[SerialFrame | SerialLine, ...]:
        """All frames, or all lines."""
        return (*self.frames, *self.lines)

    @property
    def fields(self) -> tuple[SerialField, ...]:
        """All fields of all frames and lines."""
        return tuple(field for part in self.parts for field in part.fields)

    @property
    def kinds(self) -> frozenset[str]:
        """Kinds of values that it sends, `state.…` among them."""
        return frozenset(field.kind for field in self.fields)

    @property
    def ages(self) -> dict[str, float | None]:
        """Return the age from which values are missing, by kind [s]; None: as it is measured."""
        return {
            kind: longest_age(field.max_age_s for field in self.fields if field.kind == kind) for kind in self.kinds
        }


def longest_age(ages: Iterable[float | None]) -> float | None:
    """Return the longest age of several ways; one that is measured leaves all measured."""
    given = list(ages)
    stated = [age for age in given if age is not None]
    return max(stated) if stated and len(stated) == len(given) else None
