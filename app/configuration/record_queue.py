"""Records on their way into the signed log: written by a thread of its own, so that nobody waits long for a disk."""

import errno
import logging
import threading
from collections import deque
from dataclasses import dataclass, field

from app.configuration.history import Action, ConfigHistory

log = logging.getLogger(__name__)
RETRY_S = 1.0  # where the disk does not take a record that is kept
MOST = 1000  # records that wait


@dataclass(slots=True, eq=False)
class Entry:
    """A record that waits, or has waited, for the disk.

    Attributes:
        after: the intent of which it is the outcome.
        is_kept: it is tried until the disk takes it; else once.
        number: of the record, once it is on the disk.
        error: why the last try failed.
        is_withdrawn: nobody acts on it any more.
    """

    t_wall_ns: int
    who: str
    action: Action
    source: str
    reason: str
    before: bytes
    after_image: bytes
    result: str
    after: "Entry | None"
    is_kept: bool
    number: int | None = None
    error: OSError | None = None
    is_withdrawn: bool = False
    tried: threading.Event = field(default_factory=threading.Event)


class RecordQueue:
    """In order, from any thread; what still waits when the process ends is lost, and named in its log."""

    def __init__(self, history: ConfigHistory) -> None:
        """Begin empty; the thread starts with the first record."""
        self._history = history
        self._entries: deque[Entry] = deque()
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._is_closing = False

    def put(self, entry: Entry) -> None:
        """Queue a record; where too many wait it has failed on return."""
        with self._changed:
            if len(self._entries) >= MOST:
                entry.error = OSError(errno.ENOBUFS, "too many records wait for the disk")
                entry.tried.set()
                return
            self._entries.append(entry)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="signed log", daemon=True)
                self._thread.start()
            self._changed.notify_all()

    def withdraw(self, entry: Entry) -> None:
        """Leave a record out; where it is being written its outcome follows: nothing was done."""
        with self._changed:
            entry.is_withdrawn = True

    def close(self, timeout_s: float) -> None:
        """Try once more what waits, and end the thread, unless the disk takes longer."""
        with self._changed:
            self._is_closing, thread = True, self._thread
            self._changed.notify_all()
        if thread is not None:
            thread.join(timeout_s)
        if self._entries:
            log.error("%d records are not in the signed log", len(self._entries))

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._entries:
                    if self._is_closing:
                        return
                    self._changed.wait()
                entry, is_last_try = self._entries[0], self._is_closing
                if entry.is_withdrawn:
                    self._entries.popleft()
                    continue
            self._write(entry)
            with self._changed:
                if entry.error is None or not entry.is_kept:
                    self._entries.popleft()
                    if entry.is_withdrawn and entry.error is None:
                        self._entries.append(_undone(entry))
                    entry.tried.set()
                    continue
                self._fail_others(entry)
                if is_last_try:
                    return
                self._changed.wait(RETRY_S)

    def _write(self, entry: Entry) -> None:
        number = None if entry.after is None else entry.after.number
        try:
            entry.number = self._history.append(
                entry.t_wall_ns, entry.who, entry.action, entry.source, entry.reason,
                entry.before, entry.after_image, entry.result, number,
            )  # fmt: skip
            entry.error = None
        except OSError as error:
            entry.error = error

    def _fail_others(self, failed: Entry) -> None:
        """What waits behind a record that the disk does not take fails as well; what is kept stays."""
        for entry in self._entries:
            entry.error = failed.error
            entry.tried.set()
        self._entries = deque(entry for entry in self._entries if entry.is_kept)


def _undone(entry: Entry) -> Entry:
    return Entry(
        entry.t_wall_ns, entry.who, entry.action, entry.source, entry.reason,
        entry.before, entry.after_image, "nothing was changed: the disk was too slow", entry, is_kept=True,
    )  # fmt: skip
