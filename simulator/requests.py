"""What the master does with a request, and what it answers. A refusal has changed nothing."""

from typing import TYPE_CHECKING

from firmware_protocol.config_image import check
from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import Frame
from firmware_protocol.memory_map import CONFIG_SIZE, MASTER_SIZE, N_CAN_MESSAGES
from firmware_protocol.messages import (
    EEPROM_READ_BASE,
    MAX_READ,
    NO_OFFSET,
    Command,
    CommandId,
    Event,
    EventCode,
    IdentRequest,
    Load,
    MessageType,
    Read,
    Reply,
    Request,
    Result,
    Store,
    Write,
    decode_request,
)
from simulator.eeprom import SIZE as EEPROM_SIZE
from simulator.soc_counter import SOC_SCALE

if TYPE_CHECKING:
    from simulator.master import VirtualMaster

REPEAT_WINDOW_S = 2.0
_KNOWN_TYPES = frozenset(MessageType) - {MessageType.DATA, MessageType.REPLY, MessageType.EVENT}


class Refused(Exception):
    """The request is refused; `result` and `offset` go into the reply."""

    def __init__(self, result: Result, offset: int = NO_OFFSET) -> None:
        self.result = result
        self.offset = offset
        super().__init__(f"{result.name} at {offset}")


class RequestHandler:
    """Carries out requests; the same request sent again within two seconds gets the same answer, nothing is redone."""

    def __init__(self, master: "VirtualMaster") -> None:
        self._master = master
        self._last: tuple[int, int, bytes] | None = None
        self._last_reply: Reply | None = None
        self._last_s = 0.0

    def handle(self, frame: Frame, now_s: float) -> Reply | None:
        """Return the reply; None where it comes later (STORE) or was asked for again while it is on its way."""
        key = (frame.type, frame.sequence, frame.body)
        repeatable = frame.type in (MessageType.IDENT, MessageType.READ)
        if not repeatable and key == self._last and now_s - self._last_s < REPEAT_WINDOW_S:
            return self._last_reply
        try:
            data = self._carry_out(frame, now_s)
        except Refused as refusal:
            reply: Reply | None = Reply(frame.type, frame.sequence, refusal.result, refusal.offset)
        else:
            reply = None if data is None else Reply(frame.type, frame.sequence, Result.DONE, NO_OFFSET, data)
        if not repeatable:
            self._last, self._last_reply, self._last_s = key, reply, now_s
        return reply

    def finished(self, reply: Reply) -> None:
        """Remember a reply that came later than its request."""
        if self._last is not None and self._last[:2] == (reply.request_type, reply.request_sequence):
            self._last_reply = reply

    def _carry_out(self, frame: Frame, now_s: float) -> bytes | None:
        if frame.type not in _KNOWN_TYPES:
            raise Refused(Result.UNKNOWN_REQUEST)
        try:
            request: Request = decode_request(frame)
        except DecodeError:
            raise Refused(Result.BAD_LENGTH) from None
        match request:
            case IdentRequest():
                return self._master.ident().to_bytes()
            case Read(offset, length):
                return self._read(offset, length)
            case Write(offset, data):
                return self._write(offset, data)
            case Store():
                if not self._master.store.start(frame.sequence, self._master.memory.config, now_s):
                    raise Refused(Result.NOT_NOW)
                return None
            case Load():
                return self._load()
            case Command(command, argument):
                return self._command(command, argument, now_s)

    def _read(self, offset: int, length: int) -> bytes:
        if not 0 < length <= MAX_READ:
            raise Refused(Result.BAD_LENGTH)
        if offset >= EEPROM_READ_BASE:
            address = offset - EEPROM_READ_BASE
            if address + length > EEPROM_SIZE:
                raise Refused(Result.OUT_OF_BOUNDS, offset)
            if self._master.store.is_busy:
                raise Refused(Result.NOT_NOW)
            return self._master.board.eeprom.read(address, length)
        if offset + length > MASTER_SIZE:
            raise Refused(Result.OUT_OF_BOUNDS, offset)
        return bytes(self._master.memory.image[offset : offset + length])

    def _write(self, offset: int, data: bytes) -> bytes:
        if not data:
            raise Refused(Result.BAD_LENGTH)
        if offset + len(data) > CONFIG_SIZE:
            raise Refused(Result.OUT_OF_BOUNDS, offset)
        config = bytearray(self._master.memory.config)
        config[offset : offset + len(data)] = data
        errors = check(bytes(config))
        if errors:
            raise Refused(Result.OUT_OF_RANGE, errors[0].offset)
        self._master.use_config(bytes(config))
        self._master.emit(Event(EventCode.CONFIG_WRITTEN, 0, NO_OFFSET, offset, len(data)))
        return b""

    def _load(self) -> bytes:
        if self._master.store.is_busy:
            raise Refused(Result.NOT_NOW)
        config = self._master.store.newest_config()
        if config is None:
            raise Refused(Result.NOTHING_STORED)
        self._master.use_config(config)
        self._master.emit(Event(EventCode.CONFIG_WRITTEN, 0, NO_OFFSET, 0, CONFIG_SIZE))
        return b""

    def _command(self, command: int, argument: int, now_s: float) -> bytes:
        limits = {
            CommandId.FAN_OVERRIDE: (-1, 255),
            CommandId.SET_SOC: (0, SOC_SCALE),
            CommandId.CAN_TX_ENABLE: (0, (1 << N_CAN_MESSAGES) - 1),
            CommandId.CAN_SEND: (0, N_CAN_MESSAGES - 1),
        }
        try:
            known = CommandId(command)
        except ValueError:
            raise Refused(Result.UNKNOWN_REQUEST) from None
        low, high = limits.get(known, (argument, argument))
        if not low <= argument <= high:
            raise Refused(Result.OUT_OF_RANGE)
        if not self._master.command(known, argument, now_s):
            raise Refused(Result.NOT_NOW)
        return b""
