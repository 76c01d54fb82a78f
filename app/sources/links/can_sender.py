"""Frames onto the CAN bus, one list at a time: single ones, periodic ones, or those of a recorded session.

For bringing up an ECU or a charger without a car; who may do it where is for the caller to say.
"""

import heapq
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from app.clock import Clock
from app.errors import LinkError, NotNow, message_of
from app.words import Message, Text

MIN_PERIOD_S = 0.001


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A frame; bit 31 of the id marks a 29-bit one. Without a period it is sent once, `count` 0 repeats for ever."""

    can_id: int
    data: bytes
    period_s: float | None = None
    count: int = 0


@dataclass(frozen=True, slots=True)
class SenderStatus:
    """State of the frames that are sent."""

    what: str | None = None
    who: str | None = None
    sent: int = 0
    total: int | None = None  # None where it goes on for ever
    error: Text | None = None


class CanSender:
    """Owns a thread while something is sent."""

    def __init__(self, send: Callable[[int, bytes], None], clock: Clock) -> None:
        self._send = send
        self._clock = clock
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._status = SenderStatus()

    @property
    def status(self) -> SenderStatus:
        """Return the frames sent now, or the result of the last list."""
        return self._status

    @property
    def is_busy(self) -> bool:
        """A list is being sent."""
        return self._thread is not None and self._thread.is_alive()

    def once(self, frames: Sequence[Outgoing]) -> int:
        """Send each frame now and return how many.

        Raises:
            LinkError: the bus refused one; those before it were sent.
        """
        for frame in frames:
            self._send(frame.can_id, frame.data)
        return len(frames)

    def start_list(self, frames: Sequence[Outgoing], who: str) -> None:
        """Send a list until all its counts are used up; what has no period leaves at once.

        Raises:
            NotNow: another list is being sent.
        """
        counts = [1 if frame.period_s is None else frame.count for frame in frames]
        total = None if 0 in counts else sum(counts)
        self.start_frames(f"list of {len(frames)}", _schedule(frames), total, who)

    def start_frames(self, what: str, frames: Iterator[tuple[float, int, bytes]], total: int | None, who: str) -> None:
        """Send (seconds from the start, id, data) in their own time; NotNow as start_list."""
        with self._lock:
            if self.is_busy:
                raise NotNow(Message("being-sent", what=self._status.what, who=self._status.who))
            self._stopping.clear()
            self._status = SenderStatus(what, who, 0, total)
            self._thread = threading.Thread(target=self._run, args=(frames,), name="can-sender", daemon=True)
            self._thread.start()

    def stop(self) -> SenderStatus:
        """End what is being sent and return how far it came."""
        with self._lock:
            self._stopping.set()
            if self._thread is not None:
                self._thread.join(timeout=3.0)
            return self._status

    def _run(self, frames: Iterator[tuple[float, int, bytes]]) -> None:
        started_s = self._clock.monotonic_s()
        status, sent = self._status, 0
        error: Text | None = None
        try:
            for due_s, can_id, data in frames:
                if self._stopping.wait(max(0.0, started_s + due_s - self._clock.monotonic_s())):
                    break
                self._send(can_id, data)
                sent += 1
                self._status = SenderStatus(status.what, status.who, sent, status.total)
        except LinkError as failure:
            error = message_of(failure)
        self._status = SenderStatus(status.what, status.who, sent, status.total, error)


def _schedule(frames: Sequence[Outgoing]) -> Iterator[tuple[float, int, bytes]]:
    """Yield (seconds from the start, id, data) in order of time."""
    due = [(0.0, index, 0) for index in range(len(frames))]
    heapq.heapify(due)
    while due:
        at_s, index, done = heapq.heappop(due)
        frame = frames[index]
        yield at_s, frame.can_id, frame.data
        if frame.period_s is not None and (frame.count == 0 or done + 1 < frame.count):
            heapq.heappush(due, (at_s + max(frame.period_s, MIN_PERIOD_S), index, done + 1))
