"""The bodies of frames: immutable values to bytes and back.

Master to host: Data, Reply, Event. Host to master: IdentRequest, Read, Write, Store, Load, Command.
READ offsets below 0x8000 address the master struct, from 0x8000 on the 32 kB EEPROM.
"""

import enum
import struct
from dataclasses import dataclass
from typing import NamedTuple

from firmware_protocol.errors import DecodeError, EncodeError
from firmware_protocol.framing import MAX_BODY, Frame
from firmware_protocol.memory_map import CELLS_PER_PACK, CONFIG_SIZE, MAP_HASH, MASTER_SIZE, N_CAN_MESSAGES, N_PACKS

PROTOCOL_VERSION = 1
EEPROM_READ_BASE = 0x8000
TIMEOUT_S = 0.6  # for a reply: a 512-byte frame ahead of it takes 50 ms, the reply itself as long
STORE_TIMEOUT_S = 3.0  # for that to STORE and LOAD: page writes of 5 ms and their verification
REPEAT_WINDOW_S = 10.0  # longer than all tries of the slowest request; then the same bytes are a new request
_WINDOW = struct.Struct("<HH")
_REPLY = struct.Struct("<BBBH")
_EVENT = struct.Struct("<BBHii")
_IDENT = struct.Struct("<H3B8sBI")
_COMMAND = struct.Struct("<Bi")
NO_OFFSET = 0xFFFF
MAX_READ = MAX_BODY - _REPLY.size


def _pack(layout: struct.Struct, what: str, *values: int | bytes) -> bytes:
    try:
        return layout.pack(*values)
    except struct.error as error:
        raise EncodeError(what, values, str(error)) from error


class MessageType(enum.IntEnum):
    """The frame's type byte."""

    DATA = 0x01
    REPLY = 0x02
    EVENT = 0x03
    IDENT = 0x10
    READ = 0x11
    WRITE = 0x12
    STORE = 0x13
    LOAD = 0x14
    COMMAND = 0x20


class Result(enum.IntEnum):
    """The result of a request; everything but DONE is a refusal that changed nothing."""

    DONE = 0
    UNKNOWN_REQUEST = 1  # type or command the master does not know
    BAD_LENGTH = 2
    OUT_OF_BOUNDS = 3  # offset or length outside what may be read or written
    OUT_OF_RANGE = 4  # a configuration value outside its field's range; `offset` names the field
    NOT_NOW = 5  # driving, charging or a fault forbids it
    EEPROM_FAILED = 6  # write did not read back
    NOTHING_STORED = 7  # LOAD without a valid slot


class CommandId(enum.IntEnum):
    """Named commands and their argument."""

    CHARGE_START = 1
    CHARGE_STOP = 2
    BALANCE_START = 3
    BALANCE_STOP = 4
    FAN_OVERRIDE = 5  # duty 0..255, + 256 s to end by itself (0: never); -1 gives the fans back to the ramp
    CLEAR_FAULTS = 6
    SET_SOC = 7  # 0.01 %, 0..10000
    CAN_TX_ENABLE = 8  # bit mask of messages to send
    CAN_SEND = 9  # index of a tx message, sent once
    RESET = 10
    BALANCE_CELLS = 11  # by hand: the cells of one pack to bleed, pack << 12 | mask; ends by itself
    SOC_FROM_OCV = 12  # start the count again from the voltage at rest


MAX_FAN_OVERRIDE_S = 3600

# Lowest and highest argument of each command that has one; the others take any.
COMMAND_ARGUMENTS: dict[CommandId, tuple[int, int]] = {
    CommandId.FAN_OVERRIDE: (-1, MAX_FAN_OVERRIDE_S << 8 | 0xFF),
    CommandId.SET_SOC: (0, 10_000),
    CommandId.CAN_TX_ENABLE: (0, (1 << N_CAN_MESSAGES) - 1),
    CommandId.CAN_SEND: (0, N_CAN_MESSAGES - 1),
    CommandId.BALANCE_CELLS: (0, (N_PACKS << CELLS_PER_PACK) - 1),
}


class EventCode(enum.IntEnum):
    """An event of the master; `cell`, `value` and `limit` are in the counts of the field they concern."""

    BOOT = 1  # value: reset cause (0 power on, 1 watchdog, 2 brown-out, 3 commanded)
    TRIP_V_MIN = 2
    TRIP_V_MAX = 3
    TRIP_T_MIN = 4
    TRIP_T_MAX = 5
    TRIP_I_DISC = 6
    TRIP_I_CHRG = 7
    TRIP_SLAVE_LOST = 8  # cell: first cell of the pack
    TRIP_SENSOR_LOST = 9  # current sensor or a cell's wire
    FAULTS_CLEARED = 10
    CHARGER_STATE = 11  # value: new state
    CONFIG_WRITTEN = 12
    CONFIG_STORED = 13  # value: EEPROM counter
    CAN_RX_TIMEOUT = 14  # value: rx message index
    EEPROM_INVALID = 15  # defaults in force
    SOC_SET = 16  # value: 0.01 %


class Window(NamedTuple):
    """A byte range of the master struct."""

    offset: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Data:
    """Telemetry: windows that were copied at one instant."""

    windows: tuple[Window, ...]

    def to_body(self) -> bytes:
        """Return the body; EncodeError where a window lies outside the struct or the body is too long."""
        parts = []
        for window in self.windows:
            if window.offset < 0 or window.offset + len(window.data) > MASTER_SIZE:
                raise EncodeError("window", f"{window.offset}+{len(window.data)}", f"within {MASTER_SIZE} bytes")
            parts += [_WINDOW.pack(window.offset, len(window.data)), window.data]
        body = b"".join(parts)
        if len(body) > MAX_BODY:
            raise EncodeError("body", f"{len(body)} bytes", f"at most {MAX_BODY} bytes")
        return body

    @classmethod
    def from_body(cls, body: bytes) -> "Data":
        """Parse a body; DecodeError where any window is cut or lies outside the struct (then none counts)."""
        windows: list[Window] = []
        position = 0
        while position < len(body):
            if position + _WINDOW.size > len(body):
                raise DecodeError("DATA", "window header cut", position)
            offset, length = _WINDOW.unpack_from(body, position)
            position += _WINDOW.size
            if position + length > len(body):
                raise DecodeError("DATA", f"window of {length} bytes cut", position)
            if offset + length > MASTER_SIZE:
                raise DecodeError("DATA", f"window {offset}+{length} ends beyond {MASTER_SIZE}", position)
            windows.append(Window(offset, body[position : position + length]))
            position += length
        return cls(tuple(windows))


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to one request, named by its type and sequence; `offset` is the one at fault, else NO_OFFSET."""

    request_type: int
    request_sequence: int
    result: int
    offset: int = NO_OFFSET
    data: bytes = b""

    def to_body(self) -> bytes:
        """Return the body; EncodeError where a number does not fit."""
        return _pack(_REPLY, "REPLY", self.request_type, self.request_sequence, self.result, self.offset) + self.data

    @classmethod
    def from_body(cls, body: bytes) -> "Reply":
        """Parse a body; DecodeError where it is too short."""
        if len(body) < _REPLY.size:
            raise DecodeError("REPLY", f"{len(body)} bytes, at least {_REPLY.size}")
        request_type, request_sequence, result, offset = _REPLY.unpack_from(body)
        return cls(request_type, request_sequence, result, offset, body[_REPLY.size :])


@dataclass(frozen=True, slots=True)
class EventMessage:
    """Something that happened in the master. `code` may be one this version does not know."""

    code: int
    argument: int
    cell: int  # 0..95, NO_OFFSET without one
    value: int
    limit: int

    def to_body(self) -> bytes:
        """Return the body; EncodeError where a number does not fit."""
        return _pack(_EVENT, "EVENT", self.code, self.argument, self.cell, self.value, self.limit)

    @classmethod
    def from_body(cls, body: bytes) -> "EventMessage":
        """Parse a body; DecodeError where its length is wrong."""
        if len(body) != _EVENT.size:
            raise DecodeError("EVENT", f"{len(body)} bytes, not {_EVENT.size}")
        return cls(*_EVENT.unpack(body))


@dataclass(frozen=True, slots=True)
class Ident:
    """The data of IDENT's reply: who the master is."""

    firmware: tuple[int, int, int]
    map_hash: bytes = MAP_HASH
    protocol: int = PROTOCOL_VERSION
    reset_cause: int = 0
    boots: int = 0

    @property
    def is_compatible(self) -> bool:
        """Same protocol, same memory map: the host may write."""
        return self.protocol == PROTOCOL_VERSION and self.map_hash == MAP_HASH

    def to_bytes(self) -> bytes:
        """Return the reply's data; EncodeError where a number does not fit."""
        return _pack(_IDENT, "IDENT", self.protocol, *self.firmware, self.map_hash, self.reset_cause, self.boots)

    @classmethod
    def from_bytes(cls, data: bytes) -> "Ident":
        """Parse the reply's data; DecodeError where it is too short (later versions may append)."""
        if len(data) < _IDENT.size:
            raise DecodeError("IDENT", f"{len(data)} bytes, at least {_IDENT.size}")
        protocol, major, minor, patch, map_hash, reset_cause, boots = _IDENT.unpack_from(data)
        return cls((major, minor, patch), map_hash, protocol, reset_cause, boots)


@dataclass(frozen=True, slots=True)
class IdentRequest:
    """Ask who the master is."""


@dataclass(frozen=True, slots=True)
class Read:
    """Ask for bytes of the struct, or from EEPROM_READ_BASE on of the EEPROM."""

    offset: int
    length: int


@dataclass(frozen=True, slots=True)
class Write:
    """Replace bytes of the configuration in force, all or none."""

    offset: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Store:
    """Write the configuration in force to the EEPROM's older slot."""


@dataclass(frozen=True, slots=True)
class Load:
    """Put the EEPROM's newest valid configuration in force."""


@dataclass(frozen=True, slots=True)
class Command:
    """A named command with its argument."""

    id: int
    argument: int = 0


Request = IdentRequest | Read | Write | Store | Load | Command
FromMaster = Data | Reply | EventMessage


def encode_request(request: Request) -> tuple[MessageType, bytes]:
    """Return a request's frame type and body.

    Raises:
        EncodeError: a write outside the configuration, a read too long for one reply, a number that does not fit.
    """
    match request:
        case Read(offset, length):
            if not 0 < length <= MAX_READ:
                raise EncodeError("length", length, f"1..{MAX_READ}")
            if not 0 <= offset <= 0xFFFF:
                raise EncodeError("offset", offset, "0..65535")
            return MessageType.READ, _WINDOW.pack(offset, length)
        case Write(offset, data):
            if offset < 0 or not data or offset + len(data) > CONFIG_SIZE:
                raise EncodeError("window", f"{offset}+{len(data)}", f"within the configuration, 0..{CONFIG_SIZE}")
            return MessageType.WRITE, _WINDOW.pack(offset, len(data)) + data
        case Command(command, argument):
            return MessageType.COMMAND, _pack(_COMMAND, "COMMAND", command, argument)
        case IdentRequest():
            return MessageType.IDENT, b""
        case Store():
            return MessageType.STORE, b""
        case Load():
            return MessageType.LOAD, b""


def decode_message(frame: Frame) -> FromMaster:
    """Return the message in a frame from the master.

    Raises:
        DecodeError: unknown type, or a body that does not fit it.
    """
    match frame.type:
        case MessageType.DATA:
            return Data.from_body(frame.body)
        case MessageType.REPLY:
            return Reply.from_body(frame.body)
        case MessageType.EVENT:
            return EventMessage.from_body(frame.body)
    raise DecodeError("message", f"unknown type {frame.type:#04x}")
