"""How long frames take from their arrival to the disk, measured at each commit."""

from collections import deque
from collections.abc import Iterable

from app.sessions.recording.session_writer import TableRow

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
        return max((each for each in (self._newest_s, waits_s) if each is not None), default=None)
