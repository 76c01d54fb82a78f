"""Requests to the master over the RS232 link: one at a time, tried again. Thread-safe, blocking."""

import secrets
import threading
from collections.abc import Callable

from app.clock import Clock
from app.errors import LinkLost, MasterRefused, MasterSilent, NotNow
from app.words import Message
from firmware_protocol.exchange import Exchange, GaveUp
from firmware_protocol.messages import (
    MAX_READ,
    NO_OFFSET,
    IdentRequest,
    Load,
    Read,
    Reply,
    Request,
    Result,
    Store,
    Write,
)

UNREAD_MAX_S = 5.0  # what was received and is not worked on for longer counts as no reply
WAIT_MIN_S = 0.01  # until the next look while a reply may be unread
MAX_WAITING = 4  # requests behind the one that is out; a silent master must not take all of the server's threads


class MasterClient:
    """Sends requests through `send` and waits for what `on_reply` is given."""

    def __init__(
        self,
        send: Callable[[bytes], None],
        clock: Clock,
        *,
        unread_since_ns: Callable[[], int | None] = lambda: None,
    ) -> None:
        """Prepare the client.

        Args:
            send: puts a frame on the line.
            clock: for the time that a reply may take.
            unread_since_ns: when the oldest of what arrived and is not read yet came, monotonic [ns]; None = all is
                read. A reply may be in it, so this time is not counted against the master, up to UNREAD_MAX_S.
        """
        self._send = send
        self._clock = clock
        self._unread_since_ns = unread_since_ns
        self._one_at_a_time = threading.Lock()
        self._changed = threading.Condition()
        self._exchange = Exchange(secrets.randbelow(256))
        self._reply: Reply | None = None
        self._places = threading.BoundedSemaphore(1 + MAX_WAITING)
        self._is_closed = False

    def close(self) -> None:
        """Let whoever waits give up now, and nobody ask any more."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def awaits(self, reply: Reply) -> bool:
        """Return whether somebody waits for this reply."""
        with self._changed:
            return self._exchange.awaits(reply)

    def on_reply(self, reply: Reply) -> None:
        """Take a reply off the stream; one that nobody waits for is dropped."""
        with self._changed:
            if self._exchange.on_reply(reply):
                self._reply = reply
                self._changed.notify_all()

    def request(self, request: Request) -> Reply:
        """Send a request and return the reply, whose result is DONE.

        Raises:
            LinkLost: the port is not open.
            NotNow: too many requests are waiting already.
            MasterSilent: no reply after all tries; a write may or may not have been done.
            MasterRefused: the master answered with another result than DONE; nothing was changed.
        """
        name = type(request).__name__.upper()
        if not self._places.acquire(blocking=False):
            raise NotNow(Message("too-many-requests"))
        try:
            with self._one_at_a_time, self._changed:
                try:
                    reply = self._ask(request)
                finally:
                    if self._exchange.is_busy:
                        self._exchange = Exchange(secrets.randbelow(256))
        finally:
            self._places.release()
        if isinstance(reply, GaveUp):
            raise MasterSilent(Message("no-reply-to", request=name, tries=reply.tries))
        if reply.result != Result.DONE:
            result = Result(reply.result).name if reply.result in set(Result) else f"result {reply.result}"
            raise MasterRefused(name, result, None if reply.offset == NO_OFFSET else reply.offset)
        return reply

    def _ask(self, request: Request) -> Reply | GaveUp:
        """Send until there is a reply or no try is left; `_changed` is held, and released while waiting."""
        self._reply = None
        due: bytes | GaveUp | None = self._exchange.start(request, self._clock.monotonic_s())
        while self._reply is None:
            if self._is_closed:
                raise LinkLost(Message("service-stopping"))
            if isinstance(due, GaveUp):
                return due
            if due is not None:
                self._send(due)
            if self._reply is None:  # a master in this very process answers before `send` returns
                self._changed.wait(max(WAIT_MIN_S, (self._exchange.deadline_s or 0.0) - self._read_until_s()))
            due = None if self._reply is not None else self._exchange.poll(self._read_until_s())
        return self._reply

    def _read_until_s(self) -> float:
        """The time up to which everything that arrived has been read [s]: later than that a reply cannot be missed."""
        now_s, since_ns = self._clock.monotonic_s(), self._unread_since_ns()
        return now_s if since_ns is None else min(now_s, max(since_ns / 1e9, now_s - UNREAD_MAX_S))

    def identify(self) -> None:
        """Ask who the master is; the pipeline reads the answer off the stream."""
        self.request(IdentRequest())

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

    def write(self, offset: int, data: bytes) -> None:
        """Replace bytes of the configuration in force, all or none."""
        self.request(Write(offset, data))

    def store(self) -> None:
        """Store the configuration in force."""
        self.request(Store())

    def load(self) -> None:
        """Put the stored configuration in force."""
        self.request(Load())
