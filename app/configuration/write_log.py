"""The signed log of changes to a car; those of the configuration are a line in the event log, too."""

import errno
import logging
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Protocol

from app.clock import Clock
from app.configuration.history import BEGUN, Action, ConfigHistory, OtherAction
from app.errors import message_of
from app.sessions.errors import RecordingFailed
from app.telemetry import Severity
from app.words import Message, Quantity
from firmware_protocol.config_image import Change, image_hash

log = logging.getLogger(__name__)
RETRY_S = 1.0  # where the disk does not take a record that is kept
MOST = 1000  # records that wait
NO_IMAGE = b""
INTENT_S = 0.5  # for the intent to be on the disk; then nothing is done
NEEDED_S = 0.2  # for that of what is done all the same
OUTCOME_S = 0.3  # for the outcome; then it is written when the disk takes it


class Note(Protocol):
    """Writes a line into the event log."""

    def __call__(self, severity: Severity, code: str, message: Message, who: str | None = None) -> None:
        """Write it."""


@dataclass(slots=True)
class Attempt:
    """Somebody changes the configuration; the images are filled in as they become known."""

    who: str
    action: Action
    source: str
    reason: str = ""
    before: bytes = NO_IMAGE
    after: bytes = NO_IMAGE
    number: int | None = None  # number of its record, once it has begun
    intent: "Entry | None" = None


@dataclass(slots=True, eq=False)
class Entry:
    """A record that waits, or has waited, for the disk.

    Attributes:
        attempt: what it is of, as it was then.
        is_kept: it is tried until the disk takes it; else once.
        number: of the record, once it is on the disk.
        error: why the last try failed.
        is_withdrawn: nobody acts on it any more.
    """

    t_wall_ns: int
    attempt: Attempt
    result: str
    is_kept: bool
    number: int | None = None
    error: OSError | None = None
    is_withdrawn: bool = False
    tried: threading.Event = field(default_factory=threading.Event)


class RecordQueue:
    """Records in order, from any thread; those that still wait when the process ends are lost, and named in its log."""

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
                        undone = replace(entry.attempt, intent=entry)
                        late = "nothing was changed: the disk was too slow"
                        self._entries.append(Entry(entry.t_wall_ns, undone, late, is_kept=True))
                    entry.tried.set()
                    continue
                self._fail_others(entry)
                if is_last_try:
                    return
                self._changed.wait(RETRY_S)

    def _write(self, entry: Entry) -> None:
        change, intent = entry.attempt, entry.attempt.intent
        try:
            entry.number = self._history.append(
                entry.t_wall_ns, change.who, change.action, change.source, change.reason.strip(),
                change.before, change.after, entry.result, None if intent is None else intent.number,
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


class WriteLog:
    """Thread-safe."""

    def __init__(self, history: ConfigHistory, note: Note, clock: Clock, *, patience: float = 1.0) -> None:
        """Write into a history; `patience` times as long as usual is waited for the disk."""
        self._queue = RecordQueue(history)
        self._note = note
        self._clock = clock
        self._patience = patience

    def close(self, timeout_s: float = 2.0) -> None:
        """Write what waits."""
        self._queue.close(timeout_s)

    def begun(self, attempt: Attempt) -> None:
        """The master is about to be asked.

        Raises:
            RecordingFailed: the disk has not taken it within INTENT_S, so the master must not be asked.
        """
        entry = self._put(attempt, BEGUN, is_kept=False)
        trouble = self._trouble(entry, INTENT_S)
        if trouble is not None:
            self._queue.withdraw(entry)
            message = Message("history-comes-first", error=trouble)
            self._note("warning", "config-history-failed", message, attempt.who)
            raise RecordingFailed(message) from entry.error
        attempt.number, attempt.intent = entry.number, entry

    @contextmanager
    def signed(self, who: str, action: OtherAction, what: str, *, is_needed: bool = False) -> Iterator[None]:
        """Keep the intent, then what became of what is done within.

        With `is_needed` it is done even where the log takes no intent: what ends a danger waits for no disk. Then both
        are written when the disk takes them.

        Raises:
            RecordingFailed: the log does not take it; nothing was done.
        """
        attempt = Attempt(who, action, what)
        if is_needed:
            attempt.intent = self._put(attempt, BEGUN, is_kept=True)
            attempt.intent.tried.wait(NEEDED_S * self._patience)
        else:
            self.begun(attempt)
        try:
            yield
        except Exception as error:
            self._remember(attempt, f"failed: {error}")
            raise
        self._remember(attempt, "done")

    def note(self, who: str, action: OtherAction, what: str, result: str = "done") -> None:
        """Keep what has happened already."""
        self._remember(Attempt(who, action, what), result)

    def written(self, attempt: Attempt, changes: list[Change]) -> None:
        """A configuration was written and read back."""
        listed, reason = _changes_message(changes), attempt.reason.strip()
        message = Message("config-written", changes=listed)
        if reason:
            message = Message("config-written-because", changes=listed, reason=reason)
        self._note("info", "config-written", message, attempt.who)
        self._remember(attempt, "done")

    def stored(self, attempt: Attempt) -> None:
        """The configuration in force was stored and the EEPROM read back."""
        self._note("info", "config-stored", Message("config-stored", image=image_hash(attempt.after)), attempt.who)
        self._remember(attempt, "done")

    def loaded(self, attempt: Attempt, changes: list[Change]) -> None:
        """The stored configuration was put in force and read back."""
        listed = _changes_message(changes) if changes else Message("nothing-changed")
        self._note("info", "config-loaded", Message("config-loaded", changes=listed), attempt.who)
        self._remember(attempt, "done")

    def failed(self, attempt: Attempt, error: Exception, result: str | None) -> None:
        """The change failed; `result` goes into the history where something was asked of the master."""
        why = message_of(error)
        code, message = {
            "store": ("config-store-failed", Message("config-not-stored", error=why)),
            "load": ("config-load-failed", Message("config-not-loaded", error=why)),
        }.get(attempt.action, ("config-write-failed", Message("config-not-written", error=why)))
        self._note("warning", code, message, attempt.who)
        if result is None and attempt.number is not None:
            result = f"nothing was changed: {error}"
        if result is not None:
            self._remember(attempt, result)

    def _remember(self, attempt: Attempt, result: str) -> None:
        entry = self._put(attempt, result, is_kept=True)
        trouble = self._trouble(entry, OUTCOME_S)
        if trouble is not None:
            self._note("warning", "config-history-failed", Message("history-failed", error=trouble), attempt.who)

    def _put(self, attempt: Attempt, result: str, *, is_kept: bool) -> Entry:
        entry = Entry(self._clock.wall_ns(), replace(attempt), result, is_kept)
        self._queue.put(entry)
        return entry

    def _trouble(self, entry: Entry, seconds: float) -> str | Message | None:
        """Why a record is not on the disk after so long; None where it is."""
        seconds *= self._patience
        if not entry.tried.wait(seconds):
            return Message("not-written-within", time=Quantity(seconds, "s", 1))
        return None if entry.error is None else entry.error.strerror or str(entry.error)


def _changes_message(changes: list[Change]) -> Message:
    shown = tuple(
        f"{c.field}{'' if c.element is None else f'[{c.element}]'} {c.before} -> {c.after} {c.unit}".rstrip()
        for c in changes[:8]
    )
    return Message("and-more", shown=shown, n=len(changes) - 8) if len(changes) > 8 else Message("list", shown=shown)
