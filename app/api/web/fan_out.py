"""Every snapshot to every reader of the live stream: encoded once, then one `send` each, without a task each.

A reader that has not taken the message before misses this one, and gets the newest as soon as it has.
"""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Coroutine, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from starlette.websockets import WebSocketDisconnect

from app.api.encoding.encoder import SnapshotEncoder
from app.api.web.authentication import User
from app.live.hub import Hub
from app.telemetry import Snapshot

WITHHELD_S = 0.1  # what came too early for a rate is sent so long after its time, where nothing newer comes


class ReaderConnection(Protocol):
    """The connection of a reader."""

    is_behind: bool  # it has not taken what was sent: `send` would wait
    on_drained: Callable[[], None] | None  # called when it has


@dataclass(eq=False, slots=True)
class Reader:
    """One open live stream."""

    send: Callable[[str], Awaitable[None]]
    connection: ReaderConnection
    user: User | None
    address: str
    since_s: float  # wall clock


class Timer(Protocol):
    """A call that waits in an event loop."""

    def cancel(self) -> None:
        """Wait no more."""


class Loop(Protocol):
    """The parts of an event loop that are used."""

    def time(self) -> float:
        """Return the monotonic clock [s]."""

    def call_later(self, delay: float, callback: Callable[[], None], /) -> Timer:
        """Call once, after `delay` seconds."""

    def create_task(self, task: Coroutine[Any, Any, None], /) -> object:
        """Run it."""


class FanOut:
    """The readers by their rate: those of one rate get the same snapshots. Used on the event loop alone."""

    def __init__(
        self, hub: Hub[Snapshot], encoder: SnapshotEncoder, loop: Callable[[], Loop] = asyncio.get_running_loop
    ) -> None:
        self._hub = hub
        self._encoder = encoder
        self._loop = loop
        self._readers: dict[Reader, None] = {}
        self._rates: dict[float, _Rate] = {}
        self._body = b""
        self._text = ""  # text of the body
        hub.listen(self._publish)

    @property
    def readers(self) -> list[Reader]:
        """Return who reads, the longest first."""
        return list(self._readers)

    @contextlib.contextmanager
    def joined(self, reader: Reader, rate: float | None) -> Iterator[None]:
        """Send to a reader for the length of a with-block, at most `rate` a second on average; the latest at once."""
        pause_s = 1.0 / rate if rate else 0.0
        group = self._rates.get(pause_s)
        if group is None:
            group = self._rates[pause_s] = _Rate(pause_s, self._encode, self._loop())
        self._readers[reader] = None
        group.join(reader, self._hub.latest)
        try:
            yield
        finally:
            del self._readers[reader]
            if group.leave(reader):
                del self._rates[pause_s]

    def _publish(self, snapshot: Snapshot) -> None:
        for group in self._rates.values():
            group.offer(snapshot)

    def _encode(self, snapshot: Snapshot) -> str:
        body = self._encoder.encode(snapshot)
        if body is not self._body:
            self._body, self._text = body, body.decode()
        return self._text


class _Rate:
    """Readers that want a snapshot every `pause_s`."""

    def __init__(self, pause_s: float, encode: Callable[[Snapshot], str], loop: Loop) -> None:
        self._pause_s = pause_s
        self._encode = encode
        self._loop = loop
        self._readers: dict[Reader, None] = {}
        self._behind: set[Reader] = set()
        self._newest: Snapshot | None = None
        self._due_s = loop.time()
        self._withheld: Timer | None = None

    def join(self, reader: Reader, latest: Snapshot | None) -> None:
        is_first = not self._readers
        self._readers[reader] = None
        reader.connection.on_drained = partial(self._drained, reader)
        if latest is None:
            return
        if is_first:
            self.offer(latest)
        else:
            self._newest = latest
            self._send((reader,))

    def leave(self, reader: Reader) -> bool:
        """Return whether it was the last one."""
        reader.connection.on_drained = None
        self._readers.pop(reader, None)
        self._behind.discard(reader)
        if self._readers:
            return False
        self._forget()
        return True

    def offer(self, snapshot: Snapshot) -> None:
        """Send it, or keep it until its time has come."""
        if snapshot is self._newest:
            return
        self._newest = snapshot
        early_s = self._due_s - self._loop.time()
        if early_s <= 0:
            self._send_all()
        elif self._withheld is None:
            self._withheld = self._loop.call_later(early_s + WITHHELD_S, self._send_all)

    def _send_all(self) -> None:
        self._forget()
        self._due_s = max(self._due_s, self._loop.time() - self._pause_s) + self._pause_s
        self._send(self._readers)

    def _send(self, readers: Iterable[Reader]) -> None:
        if self._newest is not None:
            self._loop.create_task(self._deliver(list(readers), self._encode(self._newest)))

    async def _deliver(self, readers: list[Reader], text: str) -> None:
        """Send without waiting for anybody: `send` waits only for a connection that is behind."""
        for reader in readers:
            if reader not in self._readers:
                continue
            if reader.connection.is_behind:
                self._behind.add(reader)
            else:
                with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it is closed: its route ends
                    await reader.send(text)

    def _drained(self, reader: Reader) -> None:
        if reader in self._behind:
            self._behind.discard(reader)
            self._send((reader,))

    def _forget(self) -> None:
        if self._withheld is not None:
            self._withheld.cancel()
            self._withheld = None
