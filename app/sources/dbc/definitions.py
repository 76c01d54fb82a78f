"""Definitions of CAN messages: signals as places of bits, messages, and irregularities of the file."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from app.words import Text

FLOAT_BITS = (16, 32, 64)  # sizes of IEEE 754


@dataclass(frozen=True, slots=True)
class BitLayout:
    """Position of a raw number in a frame, and its scale; equal layouts are extracted together."""

    start: int  # as a DBC writes it: lowest bit if little endian, highest bit (sawtooth count) if big endian
    length: int  # bits, 1 to 64
    is_little_endian: bool = True
    is_signed: bool = False
    is_float: bool = False  # IEEE 754 of 16, 32 or 64 bits
    scale: float = 1.0
    offset: float = 0.0

    @property
    def end_byte(self) -> int:
        """Bytes that a frame must have to carry it."""
        if self.is_little_endian:
            return (self.start + self.length + 7) // 8
        first = self.start // 8 * 8 + 7 - self.start % 8
        return (first + self.length + 7) // 8


@dataclass(frozen=True, slots=True)
class MultiplexCondition:
    """The frame carries a signal only where a multiplexer has one of these raw values."""

    multiplexer: str
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class SignalDefinition:
    """A signal of a message."""

    name: str
    layout: BitLayout
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    conditions: tuple[MultiplexCondition, ...] = ()  # all must hold; more than one where multiplexers are nested
    is_multiplexer: bool = False
    choices: Mapping[int, str] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, slots=True)
class MessageDefinition:
    """A message; bit 31 of the id marks a 29-bit one."""

    can_id: int
    name: str
    length: int  # bytes, as the file says; frames may be shorter or longer
    signals: tuple[SignalDefinition, ...]
    sender: str = ""
    period_s: float | None = None  # between two frames, where the file says it (GenMsgCycleTime)

    def signal(self, name: str) -> SignalDefinition | None:
        """The signal of this name."""
        return next((signal for signal in self.signals if signal.name == name), None)


@dataclass(frozen=True, slots=True)
class Oddity:
    """An irregularity of a file; loaded all the same."""

    file: str
    line: int | None
    what: Text


@dataclass(frozen=True, slots=True)
class Definitions:
    """The messages of one or more files; of two with one id the first counts."""

    messages: tuple[MessageDefinition, ...]
    oddities: tuple[Oddity, ...] = ()

    def by_id(self) -> dict[int, MessageDefinition]:
        """The messages by id."""
        return {message.can_id: message for message in reversed(self.messages)}

    def joined(self, other: "Definitions") -> "Definitions":
        """The messages of both."""
        return Definitions(self.messages + other.messages, self.oddities + other.oddities)
