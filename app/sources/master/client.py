"""Requests to the master over the RS232 link: one at a time, tried again. Thread-safe, blocking.

A request that stays unanswered is sent again, byte for byte; the master knows a repeated one by its type, sequence and
body and answers it without doing it twice, so any request may be repeated, but not over another connection: another
master, at its end, would do it. Replies come from the link's own thread.
"""

import secrets
import threading
from collections.abc import Callable

from app.clock import Clock
from app.errors import LinkLost, MasterRefused, MasterSilent, NotNow
from app.telemetry import Identity
from app.words import Message
from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import BadFrame, Frame, encode_frame
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import (
    MAX_READ,
    NO_OFFSET,
    STORE_TIMEOUT_S,
    TIMEOUT_S,
    Ident,
    IdentRequest,
    MessageType,
    Read,
    Reply,
    Request,
    Result,
    encode_request,
)

TRIES = 3
MAX_WAITING = 4  # requests behind the one that is out; a silent master must not take all of the server's threads
_SLOW_REQUESTS = (MessageType.STORE, MessageType.LOAD)


class MasterClient:
    """Sends requests through `send` and waits for the replies that `on_frame` is given."""

    def __init__(self, send: Callable[[bytes], None], clock: Clock) -> None:
        self.identity: Identity | None = None  # as the connected master last answered `identify`
        self._send = send
        self._clock = clock
        self._one_at_a_time = threading.Lock()
        self._places = threading.BoundedSemaphore(1 + MAX_WAITING)
        self._changed = threading.Condition()  # guards what follows; never held while sending
        self._sequence = secrets.randbelow(256)
        self._awaited: MessageType | None = None  # the newest request's type, until its reply came or the link was lost
        self._reply: Reply | None = None
        self._is_closed = False

    def close(self) -> None:
        """End every request that waits, and refuse further ones."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def on_lost(self) -> None:
        """End the request that waits: its connection is no more, and at the end of the next may be another master."""
        self.identity = None
        with self._changed:
            self._awaited = None
            self._changed.notify_all()

    def on_frame(self, frame: Frame | BadFrame) -> bool:
        """Give a reply to the request that waits for it; return False for a reply that none waits for."""
        if isinstance(frame, BadFrame) or frame.type != MessageType.REPLY:
            return True
        try:
            reply = Reply.from_body(frame.body)
        except DecodeError:
            return False
        with self._changed:
            if (reply.request_type, reply.request_sequence) != (self._awaited, self._sequence):
                return False
            self._awaited, self._reply = None, reply
            self._changed.notify_all()
            return True

    def request(self, request: Request) -> Reply:
        """Send a request and return the reply, whose result is DONE.

        Raises:
            EncodeError: the request does not fit its frame.
            LinkLost: the port is not open, or was lost before the reply; a write may or may not have been done.
            NotNow: too many requests are waiting already.
            MasterSilent: no reply after all tries; a write may or may not have been done.
            MasterRefused: the master answered with another result than DONE; nothing was changed.
        """
        kind, body = encode_request(request)
        name, timeout_s = type(request).__name__.upper(), STORE_TIMEOUT_S if kind in _SLOW_REQUESTS else TIMEOUT_S
        if not self._places.acquire(blocking=False):
            raise NotNow(Message("too-many-requests"))
        try:
            with self._one_at_a_time:
                with self._changed:
                    self._sequence = (self._sequence + 1) & 0xFF
                    self._awaited, self._reply = kind, None
                frame = encode_frame(kind, self._sequence, 0, body)
                for _ in range(TRIES):
                    deadline_s = self._clock.monotonic_s() + timeout_s
                    if not self._is_closed:
                        self._send(frame)
                    with self._changed:
                        while self._awaited and (left_s := deadline_s - self._clock.monotonic_s()) > 0:
                            if self._is_closed:
                                raise LinkLost(Message("service-stopping"))
                            self._changed.wait(left_s)
                        if (reply := self._reply) is not None:
                            break
                        if self._awaited is None:
                            raise LinkLost(Message("lost-before-reply", request=name))
        finally:
            self._places.release()
        if reply is None:
            raise MasterSilent(Message("no-reply-to", request=name, tries=TRIES))
        if reply.result != Result.DONE:
            result = Result(reply.result).name if reply.result in set(Result) else f"result {reply.result}"
            raise MasterRefused(name, result, None if reply.offset == NO_OFFSET else reply.offset)
        return reply

    def identify(self) -> Identity:
        """Ask the master who it is.

        Raises:
            MasterSilent: no reply, or one that holds no identity.
            LinkLost, NotNow, MasterRefused: see `request`.
        """
        reply = self.request(IdentRequest())
        try:
            self.identity = identity_of(Ident.from_bytes(reply.data))
        except DecodeError as error:
            raise MasterSilent(Message("no-identity")) from error
        return self.identity

    def read(self, offset: int, length: int) -> bytes:
        """Return bytes of the struct (or of the EEPROM, from 0x8000 on), in as many requests as it takes."""
        data = b""
        while len(data) < length:
            part = min(MAX_READ, length - len(data))
            reply = self.request(Read(offset + len(data), part))
            if len(reply.data) != part:
                raise MasterSilent(Message("short-read", count=len(reply.data), expected=part))
            data += reply.data
        return data


def read_field(master: MasterClient, name: str) -> tuple[int, ...]:
    """Return the counts of a field of the struct, read now."""
    field = FIELDS[name]
    return field.unpack(master.read(field.offset, field.size), -field.offset)


def identity_of(ident: Ident) -> Identity:
    """Return the data of a reply to IDENT as the service shows it."""
    firmware = ".".join(map(str, ident.firmware))
    return Identity(firmware, ident.protocol, ident.map_hash.hex(), ident.is_compatible, ident.boots)
