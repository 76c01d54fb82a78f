"""What became of every change of the configuration: a line in the event log, and a signed record in the history."""

from dataclasses import dataclass
from typing import Protocol

from app.clock import Clock
from app.configuration.history import Action, ConfigHistory
from app.telemetry import Severity
from firmware_protocol.config_image import Change, image_hash

NO_IMAGE = b""


class Note(Protocol):
    """Writes a line into the event log."""

    def __call__(self, severity: Severity, code: str, text: str, who: str | None = None) -> None:
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


class WriteLog:
    """Thread-safe."""

    def __init__(self, history: ConfigHistory, note: Note, clock: Clock) -> None:
        self._history = history
        self._note = note
        self._clock = clock

    def written(self, attempt: Attempt, changes: list[Change]) -> None:
        """A configuration was written and read back."""
        because = f" ({attempt.reason.strip()})" if attempt.reason.strip() else ""
        text = "configuration written: " + _in_words(changes) + because
        self._note("info", "config-written", text, attempt.who)
        self._remember(attempt, "done")

    def stored(self, attempt: Attempt) -> None:
        """The configuration in force was stored and the EEPROM read back."""
        text = f"configuration {image_hash(attempt.after)} stored in the EEPROM"
        self._note("info", "config-stored", text, attempt.who)
        self._remember(attempt, "done")

    def loaded(self, attempt: Attempt, changes: list[Change]) -> None:
        """The stored configuration was put in force and read back."""
        changed = _in_words(changes) or "nothing changed"
        self._note("info", "config-loaded", f"configuration loaded from the EEPROM: {changed}", attempt.who)
        self._remember(attempt, "done")

    def failed(self, attempt: Attempt, error: Exception, result: str | None) -> None:
        """The change failed; `result` goes into the history where something was asked of the master."""
        code, done = {"store": ("config-store-failed", "stored"), "load": ("config-load-failed", "loaded")}.get(
            attempt.action, ("config-write-failed", "written")
        )
        self._note("warning", code, f"configuration not {done}: {error}", attempt.who)
        if result is not None:
            self._remember(attempt, result)

    def _remember(self, attempt: Attempt, result: str) -> None:
        who, action, source, reason = attempt.who, attempt.action, attempt.source, attempt.reason.strip()
        try:
            self._history.append(
                self._clock.wall_ns(), who, action, source, reason, attempt.before, attempt.after, result
            )
        except OSError as error:
            self._note("warning", "config-history-failed", f"this write is not in the history: {error}", who)


def _in_words(changes: list[Change]) -> str:
    shown = [
        f"{c.field}{'' if c.element is None else f'[{c.element}]'} {c.before} -> {c.after} {c.unit}".rstrip()
        for c in changes[:8]
    ]
    return ", ".join(shown) + (f" and {len(changes) - 8} more" if len(changes) > 8 else "")
