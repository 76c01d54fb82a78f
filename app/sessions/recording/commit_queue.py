"""The queue to the disk: filled by any thread, emptied by the recorder's."""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable

from app.clock import Clock
from app.sessions.errors import RecordingFailed
from app.sessions.recording.session_writer import TableRow
from app.sessions.recording.waiting_rows import WaitingRows
from app.words import Message, Quantity

KEPT_S = 60.0
MOST_COMMIT_S = 0.125  # what is taken off the wait before a commit
_FRAMES = ("frames", "can_frames")


def oldest_frame_ns(rows: Iterable[TableRow]) -> int | None:
    """Return when the first frame of rows arrived, monotonic; None without one."""
    return next((row[0] for table, row in rows if table in _FRAMES), None)


class CommitDelay:
    """Written by the recorder's thread, read by any."""

    def __init__(self) -> None:
        self.commit_s = 0.0  # what a commit takes: the last one's, or a longer one's that fades
        self._newest_s: float | None = None
        self._last: deque[tuple[int, float]] = deque()

    def committed(self, oldest_ns: int | None, now_ns: int, took_s: float) -> None:
        """Count a commit, of frames of which the oldest came then."""
        self.commit_s = min(max(took_s, 0.8 * self.commit_s), MOST_COMMIT_S)
        if oldest_ns is None:
            return
        self._newest_s = max(now_ns - oldest_ns, 0) / 1e9
        self._last.append((now_ns, self._newest_s))
        while now_ns - self._last[0][0] > KEPT_S * 1e9:
            self._last.popleft()

    @property
    def longest_s(self) -> float | None:
        """The longest delay of the last minute; None before the first frame."""
        return max((delay_s for _, delay_s in self._last.copy()), default=None)

    def now_s(self, waiting_ns: int | None, now_ns: int) -> float | None:
        """Return the newest delay, or what a frame waits already where that is longer."""
        waits_s = None if waiting_ns is None else (now_ns - waiting_ns) / 1e9
        return max((second for second in (self._newest_s, waits_s) if second is not None), default=None)


COMMIT_S = 0.3  # the time that the last commits took included; at most 0.5 s of a session are not on the disk
DUE_S = 0.15  # what waits longer is committed next
PAUSE_S = 0.05  # between two commits at least
STUCK_S = 5.0  # seconds without a commit and without an error
MOST_ROWS = 2000  # in a commit: one that fails costs little, and after a stall others get their turn between two


class CommitQueue:
    """Nobody but the recorder's thread waits for the disk in it, nor holds its lock meanwhile."""

    def __init__(self, clock: Clock, limit_bytes: int) -> None:
        """Begin empty; beyond `limit_bytes` the oldest rows are left out."""
        self.lock = threading.Lock()
        self.waiting = WaitingRows(limit_bytes)  # needs the lock
        self.delay = CommitDelay()
        self._clock = clock
        self._progress = threading.Condition(self.lock)
        self.error: Message | None = None  # error of the last commits
        self._stalled_ns: int | None = None
        self._committed_s = self._began_s = time.monotonic()
        self._commits = 0  # begun
        self._given_way = -1  # the commit that somebody has waited for already

    def trouble(self) -> tuple[Message | None, int | None]:
        """Return why nothing gets onto the disk, and since when (wall clock, ns); the lock is held."""
        waited_s = self.waiting.waited_s
        silent = Message("disk-silent", time=Quantity(waited_s, "s", 0)) if waited_s > STUCK_S else None
        trouble = self.error or silent
        if trouble is None:
            self._stalled_ns = None
        elif self._stalled_ns is None:
            self._stalled_ns = self._clock.wall_ns() - round(waited_s * 1e9)
        return trouble, self._stalled_ns

    @property
    def delay_s(self) -> float | None:
        """Return how long the newest frames took from their arrival to the disk, or wait already.

        None while the disk takes nothing: to leave out other work brings nothing onto it.
        """
        with self.lock:
            if self.trouble()[0] is not None:
                return None
            waiting = oldest_frame_ns(self.waiting.oldest)
        return self.delay.now_s(waiting, self._clock.monotonic_ns())

    def wait_for_commit(self, timeout_s: float) -> None:
        """Return when a commit that runs or is due has ended, or after so long; at once where none is.

        Once for each commit, and never while the disk takes nothing: so no waits add up.
        """
        with self._progress:
            if self._given_way == self._commits or self.trouble()[0] is not None:
                return
            waiting = oldest_frame_ns(self.waiting.oldest)
            if waiting is not None and self._clock.monotonic_ns() - waiting > DUE_S * 1e9:
                self._given_way = self._commits
                self._progress.wait(timeout_s)

    def flush(self, timeout_s: float, wake: Callable[[], None]) -> None:
        """Return once all rows that are inside now are on the disk; `wake` lets the recorder's thread begin.

        Raises:
            RecordingFailed: they are not; they stay in memory and are tried again.
        """
        deadline = time.monotonic() + timeout_s
        with self._progress:
            goal = self.waiting.taken
            while self.waiting.done < goal:
                wake()
                remaining = deadline - time.monotonic()
                if remaining <= 0 or not self._progress.wait(remaining):
                    raise RecordingFailed(self.error or Message("not-written-within", time=Quantity(timeout_s, "s")))
                if self.error and self.waiting.done < goal:
                    raise RecordingFailed(self.error)

    @property
    def pause_s(self) -> float:
        """Return how long the recorder's thread waits before the next commit."""
        # What came during the last commit has waited that long already, and the next one takes as long again
        since_s = time.monotonic() - self._committed_s + 2 * self.delay.commit_s
        return max(PAUSE_S, COMMIT_S - since_s)

    @property
    def is_due(self) -> bool:
        """Return whether the last commit is so long ago that another is wanted, whatever the recorder's thread does."""
        return self.pause_s <= PAUSE_S

    def begin(self) -> int:
        """Let the next commits write all that waits; return how many lost rows no event on the disk names yet."""
        self._began_s = time.monotonic()
        with self.lock:
            self._commits += 1
            self.waiting.take()
            return self.waiting.unreported

    def next_rows(self) -> list[TableRow]:
        """Return the rows of one commit, or a session's start or end alone; empty where none waits."""
        with self.lock:
            return self.waiting.begin(MOST_ROWS)

    def finish(self, rows: list[TableRow], reported: int = 0) -> None:
        """Forget rows that are on the disk, and so many losses that were reported with them."""
        self._committed_s = time.monotonic()
        self.delay.committed(oldest_frame_ns(rows), self._clock.monotonic_ns(), self._committed_s - self._began_s)
        with self.lock:
            self.waiting.finish(len(rows), reported)

    def end(self, error: Message | None) -> None:
        """Let those go on who wait for the commits, which have failed by `error` or are on the disk."""
        with self._progress:
            self.error = error
            self._progress.notify_all()
