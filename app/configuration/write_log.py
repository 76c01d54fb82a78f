"""What became of every change of a car: a signed record, and of the configuration's a line in the event log, too."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from app.clock import Clock
from app.configuration.history import BEGUN, Action, ConfigHistory, OtherAction
from app.configuration.record_queue import Entry, RecordQueue
from app.errors import message_of
from app.sessions.errors import RecordingFailed
from app.telemetry import Severity
from app.words import Message, Quantity
from firmware_protocol.config_image import Change, image_hash

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
    number: int | None = None  # of its record, once it has begun
    intent: Entry | None = None


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
        entry = Entry(
            self._clock.wall_ns(), attempt.who, attempt.action, attempt.source, attempt.reason.strip(),
            attempt.before, attempt.after, result, attempt.intent, is_kept,
        )  # fmt: skip
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
