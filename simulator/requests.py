"""How the master carries out a request and answers it. A refused request changes nothing."""

from typing import Protocol

from firmware_protocol.config_image import canonical, check, is_live_change
from firmware_protocol.eeprom import newest
from firmware_protocol.errors import DecodeError
from firmware_protocol.exchange import RepeatFilter
from firmware_protocol.framing import Frame
from firmware_protocol.memory_map import CONFIG_SIZE, MASTER_SIZE
from firmware_protocol.messages import (
    COMMAND_ARGUMENTS,
    EEPROM_READ_BASE,
    MAX_READ,
    NO_OFFSET,
    Command,
    CommandId,
    EventCode,
    EventMessage,
    Ident,
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
from simulator.board import Board
from simulator.eeprom import SIZE as EEPROM_SIZE
from simulator.memory import MasterMemory
from simulator.storage import ConfigStore

_KNOWN_TYPES = frozenset(MessageType) - {MessageType.DATA, MessageType.REPLY, MessageType.EVENT}


def frame_key(frame: Frame) -> tuple[int, int, bytes]:
    """Return what identifies a repeated request; its uptime does not."""
    return frame.type, frame.sequence, frame.body


class Refused(Exception):
    """The request is refused; `result` and `offset` go into the reply."""

    def __init__(self, result: Result, offset: int = NO_OFFSET) -> None:
        self.result = result
        self.offset = offset
        super().__init__(f"{result.name} at {offset}")


class RequestTarget(Protocol):
    """What a request may read or change: the master, as far as the handler needs it."""

    board: Board
    memory: MasterMemory
    store: ConfigStore

    @property
    def is_at_work(self) -> bool:
        """Only live fields of the configuration may change now."""

    def ident(self) -> Ident:
        """Return the answer to IDENT."""

    def emit(self, event: EventMessage) -> None:
        """Send an event to the host."""

    def use_config(self, config: bytes) -> None:
        """Put a checked configuration in force."""

    def command(self, command: CommandId, argument: int, now_s: float) -> bool:
        """Carry out a command with a checked argument; return False where the state forbids it."""


class RequestHandler:
    """Carries out requests; a repeated request gets the same reply and is not carried out again."""

    def __init__(self, master: RequestTarget) -> None:
        self._master = master
        self._repeats = RepeatFilter()
        self._under_way: Frame | None = None  # the STORE whose reply comes when the EEPROM has it

    def handle(self, frame: Frame, now_s: float) -> Reply | None:
        """Return the reply; None where it comes later (STORE), also for a repeated STORE that is still running."""
        known = self._repeats.known_reply(frame, now_s)
        if known is not None or frame_key(frame) == (self._under_way and frame_key(self._under_way)):
            return known
        try:
            data = self._carry_out(frame, now_s)
        except Refused as refusal:
            reply = Reply(frame.type, frame.sequence, refusal.result, refusal.offset)
        else:
            if data is None:
                self._under_way = frame
                return None
            reply = Reply(frame.type, frame.sequence, Result.DONE, NO_OFFSET, data)
        self._repeats.remember(frame, reply, now_s)
        return reply

    def finished(self, reply: Reply, now_s: float) -> None:
        """Remember a reply that came later than its request."""
        frame, self._under_way = self._under_way, None
        if frame is not None and frame_key(frame)[:2] == (reply.request_type, reply.request_sequence):
            self._repeats.remember(frame, reply, now_s)

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
        if self._master.is_at_work and not is_live_change(self._master.memory.config, config):
            raise Refused(Result.NOT_NOW)
        self._use(bytes(config))
        self._master.emit(EventMessage(EventCode.CONFIG_WRITTEN, 0, NO_OFFSET, offset, len(data)))
        return b""

    def _load(self) -> bytes:
        if self._master.store.is_busy or self._master.is_at_work:
            raise Refused(Result.NOT_NOW)
        stored = newest(bytes(self._master.board.eeprom.content))
        if stored is None:
            raise Refused(Result.NOTHING_STORED)
        self._use(stored.image)
        self._master.emit(EventMessage(EventCode.CONFIG_WRITTEN, 0, NO_OFFSET, 0, CONFIG_SIZE))
        return b""

    def _use(self, config: bytes) -> None:
        """Check a configuration, set its padding to zero and put it in force."""
        errors = check(config)
        if errors:
            raise Refused(Result.OUT_OF_RANGE, errors[0].offset)
        self._master.use_config(canonical(config))

    def _command(self, command: int, argument: int, now_s: float) -> bytes:
        try:
            known = CommandId(command)
        except ValueError:
            raise Refused(Result.UNKNOWN_REQUEST) from None
        low, high = COMMAND_ARGUMENTS.get(known, (argument, argument))
        if not low <= argument <= high:
            raise Refused(Result.OUT_OF_RANGE)
        if not self._master.command(known, argument, now_s):
            raise Refused(Result.NOT_NOW)
        return b""
