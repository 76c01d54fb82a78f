"""Rows that wait for the disk: in order, counted, and bounded in bytes."""

import time
from typing import Final

from app.sessions.recording.session_writer import TableRow

ROW_BYTES: Final = 250  # what a row costs in memory beside its payload
START, STOP = "start", "stop"  # in place of a table: a session begins, a session ends


class WaitingRows:
    """A queue that forgets a row only once it is written. Every call needs the recorder's lock.

    Attributes:
        batch: what the next commit writes, oldest first; `finish` takes from it.
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
        self.items = self.bytes = self.taken = self.done = self.lost = self.unreported = 0
        self.since_s = time.monotonic()

    def offer(self, row: TableRow) -> bool:
        """Queue a row; where there is no room for it, count it as lost and return False."""
        if self.bytes + _size(row) > self._limit_bytes:
            self.lost += 1
            self.unreported += 1
            return False
        self.append(row)
        return True

    def append(self, row: TableRow) -> None:
        """Queue a row whatever waits already."""
        if not self.items:
            self.since_s = time.monotonic()
        self._behind.append(row)
        self.items += 1
        self.bytes += _size(row)
        self.taken += 1

    def take(self) -> None:
        """Let the next commit write all that waits."""
        self.batch += self._behind
        self._behind = []

    def finish(self, n: int, reported: int = 0) -> None:
        """Forget the batch's first rows, and so many losses that were reported with them."""
        finished, self.batch = self.batch[:n], self.batch[n:]
        self.items -= len(finished)
        self.bytes -= sum(map(_size, finished))
        self.done += len(finished)
        self.unreported -= reported
        self.since_s = time.monotonic()

    @property
    def n_of_session(self) -> int:
        """How many rows of the batch come before a session's start or end."""
        return next((i for i, (table, _) in enumerate(self.batch) if table in (START, STOP)), len(self.batch))

    @property
    def oldest(self) -> list[TableRow]:
        """The first row of the batch and the first behind it, where there is one."""
        return [*self.batch[:1], *self._behind[:1]]


def _size(item: TableRow) -> int:
    return ROW_BYTES + _payload_bytes(item)


def _payload_bytes(item: TableRow) -> int:
    table, row = item
    if table in ("frames", "can_frames", "configs"):
        return len(row[-1])
    if table == "estimates":
        return int(row[2].nbytes + row[3].nbytes)
    return len(row[4]) + len(row[10]) if table == "events" else len(row[3]) if table == "markers" else 0
