"""Every snapshot to every reader of the live stream: encoded and framed once, then one write each, no task each.

A reader that has not taken the message before misses this one, and gets the newest as soon as it has.
"""

import asyncio
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Protocol

from app.api.encoding.encoder import SnapshotEncoder
from app.api.web.websocket_protocol import text_frame
from app.live.hub import Hub
from app.telemetry import Snapshot

WITHHELD_S = 0.1  # what came too early for a rate is sent so long after its time, where nothing newer comes


class Stream(Protocol):
    """The websocket of a reader."""

    is_compressed: bool
    on_drained: Callable[[], None] | None  # called when it takes frames again

    def write_frame(self, frame: bytes) -> bool:
        """Write a frame; False while it does not take any."""


class Timer(Protocol):
    """What waits in a loop."""

    def cancel(self) -> None:
        """Wait no more."""


class Loop(Protocol):
    """What is needed of the event loop."""

    def time(self) -> float:
        """Return the monotonic clock [s]."""

    def call_later(self, delay: float, callback: Callable[[], None], /) -> Timer:
        """Call once, after `delay` seconds."""


class FanOut:
    """The readers by their rate: those of one rate get the same snapshots. Used on the event loop alone."""

    def __init__(
        self, hub: Hub[Snapshot], encoder: SnapshotEncoder, loop: Callable[[], Loop] = asyncio.get_running_loop
    ) -> None:
        self._hub = hub
        self._encoder = encoder
        self._loop = loop
        self._rates: dict[float, _Rate] = {}
        self._body = b""
        self._frames: dict[bool, bytes] = {}  # of the body, by whether it is compressed
        hub.listen(self._publish)

    @contextmanager
    def joined(self, stream: Stream, rate: float | None) -> Iterator[None]:
        """Send to a reader for the length of a with-block, at most `rate` a second on average; the latest at once."""
        pause_s = 1.0 / rate if rate else 0.0
        group = self._rates.get(pause_s)
        if group is None:
            group = self._rates[pause_s] = _Rate(pause_s, self._frame, self._loop())
        group.join(stream, self._hub.latest)
        try:
            yield
        finally:
            if group.leave(stream):
                del self._rates[pause_s]

    def _publish(self, snapshot: Snapshot) -> None:
        for group in self._rates.values():
            group.offer(snapshot)

    def _frame(self, snapshot: Snapshot, is_compressed: bool) -> bytes:
        body = self._encoder.encode(snapshot)
        if body is not self._body:
            self._body, self._frames = body, {}
        if is_compressed not in self._frames:
            self._frames[is_compressed] = text_frame(body, is_compressed)
        return self._frames[is_compressed]


class _Rate:
    """Readers that want a snapshot every `pause_s`."""

    def __init__(self, pause_s: float, frame: Callable[[Snapshot, bool], bytes], loop: Loop) -> None:
        self._pause_s = pause_s
        self._frame = frame
        self._loop = loop
        self._streams: dict[Stream, None] = {}
        self._behind: set[Stream] = set()
        self._newest: Snapshot | None = None
        self._due_s = loop.time()
        self._withheld: Timer | None = None

    def join(self, stream: Stream, latest: Snapshot | None) -> None:
        is_first = not self._streams
        self._streams[stream] = None
        stream.on_drained = partial(self._drained, stream)
        if latest is None:
            return
        if is_first:
            self.offer(latest)
        else:
            self._newest = latest
            self._send((stream,))

    def leave(self, stream: Stream) -> bool:
        """Tell whether it was the last one."""
        stream.on_drained = None
        self._streams.pop(stream, None)
        self._behind.discard(stream)
        if self._streams:
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
        self._send(self._streams)

    def _send(self, streams: Iterable[Stream]) -> None:
        if self._newest is None:
            return
        frames: dict[bool, bytes] = {}
        for stream in streams:
            frame = frames.get(stream.is_compressed)
            if frame is None:
                frame = frames[stream.is_compressed] = self._frame(self._newest, stream.is_compressed)
            if not stream.write_frame(frame):
                self._behind.add(stream)

    def _drained(self, stream: Stream) -> None:
        if stream in self._behind:
            self._behind.discard(stream)
            self._send((stream,))

    def _forget(self) -> None:
        if self._withheld is not None:
            self._withheld.cancel()
            self._withheld = None
