"""Rows that wait for the disk: in order, counted, and bounded in bytes."""

import time
from collections import Counter
from typing import Final

from app.sessions.recording.session_writer import TableRow

ROW_BYTES: Final = 250  # memory of a row without its payload
START, STOP = "start", "stop"  # in place of a table: a session begins, a session ends
LEFT_OUT_FIRST: Final = ("estimates",)  # they are made again from the frames
LEFT_OUT: Final = ("frames", "can_frames", "clock")
ROOM: Final = 0.01  # share of the limit that is freed at a time, so that waiting rows are rarely searched


class WaitingRows:
    """A queue that forgets a row only once it is written. Every call needs the recorder's lock.

    Attributes:
        batch: what the next commits write, oldest first; `finish` takes from it.
        items: rows that wait, those of `batch` included.
        bytes: what they take in memory.
        taken: rows ever queued.
        done: rows of those that are on the disk or given up.
        lost: rows of this session for which there was no room.
        unreported: lost rows of which no event on the disk tells yet.
        since_s: since when the oldest row waits, at the latest, monotonic.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self.batch: list[TableRow] = []
        self._behind: list[TableRow] = []  # what came since the batch was taken
        self._in_commit = 0  # the batch's first rows, which a commit is writing
        self.items = self.bytes = self.taken = self.done = self.lost = self.unreported = 0
        self.since_s = time.monotonic()

    def offer(self, row: TableRow) -> Counter[str]:
        """Queue a row, in place of the oldest ones where there is no room; count those as lost.

        Returns:
            What was lost of the newest session, rows by table; the row itself where only events wait.
        """
        left_out = Counter[str]()
        if self.bytes + _size(row) > self._limit_bytes:
            left_out = self._make_room(_size(row))
            if self.bytes + _size(row) > self._limit_bytes:
                self._lose(1)
                return left_out + Counter((row[0],))
        self.append(row)
        return left_out

    def append(self, row: TableRow) -> None:
        """Queue a row whatever waits already."""
        if not self.items:
            self.since_s = time.monotonic()
        self._behind.append(row)
        self.items += 1
        self.bytes += _size(row)
        self.taken += 1

    def take(self) -> None:
        """Let the next commit write all that waits; none is running."""
        self.batch += self._behind
        self._behind = []
        self._in_commit = 0

    def begin(self, most: int) -> list[TableRow]:
        """Return what one commit writes, at most so many rows: those before a session's start or end, or that alone."""
        first = next((i for i, (table, _) in enumerate(self.batch[:most]) if table in (START, STOP)), most)
        self._in_commit = min(max(first, 1), len(self.batch))
        return self.batch[: self._in_commit]

    def finish(self, n: int, reported: int = 0) -> None:
        """Forget the batch's first rows, and so many losses that were reported with them."""
        finished, self.batch = self.batch[:n], self.batch[n:]
        self._in_commit = 0
        self.items -= len(finished)
        self.bytes -= sum(map(_size, finished))
        self.done += len(finished)
        self.unreported -= reported
        self.since_s = time.monotonic()

    @property
    def waited_s(self) -> float:
        """Return how long the oldest row has waited, at least; 0 where none does."""
        return time.monotonic() - self.since_s if self.items else 0.0

    @property
    def n_of_session(self) -> int:
        """Return how many rows of the batch come before a session's start or end."""
        return next((i for i, (table, _) in enumerate(self.batch) if table in (START, STOP)), len(self.batch))

    @property
    def oldest(self) -> list[TableRow]:
        """The first row of the batch and the first behind it, where there is one."""
        return [*self.batch[:1], *self._behind[:1]]

    def _make_room(self, size: int) -> Counter[str]:
        """Leave out the oldest rows, what can be made again first; never those that a commit is writing."""
        goal = self._limit_bytes - max(size, round(ROOM * self._limit_bytes))
        waiting = [*self.batch[self._in_commit :], *self._behind]
        left_out = Counter[str]()
        for tables in (LEFT_OUT_FIRST, LEFT_OUT):
            kept: list[TableRow] = []
            for row in waiting:
                if row[0] == START:
                    left_out.clear()  # what was before is of another session
                if self.bytes > goal and row[0] in tables:
                    self.bytes -= _size(row)
                    left_out[row[0]] += 1
                    self._lose(1)
                    self.items -= 1
                    self.done += 1
                else:
                    kept.append(row)
            waiting = kept
        self.batch, self._behind = self.batch[: self._in_commit], waiting
        return left_out

    def _lose(self, n: int) -> None:
        self.lost += n
        self.unreported += n


def _size(item: TableRow) -> int:
    return ROW_BYTES + _payload_bytes(item)


def _payload_bytes(item: TableRow) -> int:
    table, row = item
    if table in ("frames", "configs"):
        return len(row[-1])
    if table == "can_frames":
        return len(row[3])
    if table == "estimates":
        return int(row[2].nbytes + row[3].nbytes)
    return len(row[4]) + len(row[10]) if table == "events" else len(row[3]) if table == "markers" else 0
