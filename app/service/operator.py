"""What people do to the master: every act in the event log, what changes the configuration in its history too.

Blocking; thread-safe.
"""

from collections.abc import Callable
from typing import Protocol

from app.clock import Clock
from app.configuration.history import Action, ConfigHistory
from app.configuration.safe_write import Configuration, Unverified, Written
from app.errors import LinkError, MasterRefused, NotNow
from app.service.links import Links
from app.telemetry import Severity
from firmware_protocol.config_image import Change, difference, image_hash
from firmware_protocol.eeprom import StoredConfig
from firmware_protocol.messages import Command

NO_IMAGE = b""


class Note(Protocol):
    """Writes a line into the event log."""

    def __call__(self, severity: Severity, code: str, text: str, who: str | None = None) -> None:
        """Write it."""


class Operator:
    """Carries out what a user asked for."""

    def __init__(
        self,
        configuration: Configuration,
        links: Links,
        note: Note,
        history: ConfigHistory,
        clock: Clock,
    ) -> None:
        self._configuration = configuration
        self._links = links
        self._note = note
        self._history = history
        self._clock = clock

    def write_config(
        self,
        edit: Callable[[bytes], bytes],
        expected: str,
        who: str,
        *,
        dry_run: bool,
        reason: str = "",
        source: str = "draft",
        action: Action = "write",
    ) -> Written:
        """Configuration.write, with its outcome in the event log and in the history."""
        images = {"before": NO_IMAGE, "after": NO_IMAGE}

        def watched(image: bytes) -> bytes:
            images["before"] = image
            images["after"] = edit(image)
            return images["after"]

        try:
            written = self._configuration.write(watched, expected, dry_run=dry_run, reason=reason)
        except (LinkError, NotNow) as error:
            if not dry_run:
                self._note("warning", "config-write-failed", f"configuration not written: {error}", who)
                if isinstance(error, Unverified | MasterRefused):
                    self._remember(who, action, source, reason, images["before"], images["after"], _outcome(error))
            raise
        if written.written:
            because = f" ({reason.strip()})" if reason.strip() else ""
            text = "configuration written: " + _in_words(written.changes) + because
            self._note("info", "config-written", text, who)
            self._remember(who, action, source, reason, written.before, written.image, "done")
        return written

    def store_config(self, who: str) -> StoredConfig:
        """Configuration.store, with its outcome in the event log and in the history."""
        stored_before = self._configuration.stored
        before = NO_IMAGE if stored_before is None else stored_before.image
        try:
            stored = self._configuration.store()
        except (LinkError, NotNow) as error:
            self._note("warning", "config-store-failed", f"configuration not stored: {error}", who)
            if isinstance(error, Unverified | MasterRefused):
                self._remember(who, "store", "in force", "", before, NO_IMAGE, _outcome(error))
            raise
        self._note("info", "config-stored", f"configuration {image_hash(stored.image)} stored in the EEPROM", who)
        self._remember(who, "store", "in force", "", before, stored.image, "done")
        return stored

    def load_config(self, who: str) -> bytes:
        """Configuration.load, in the event log and in the history."""
        try:
            before, image = self._configuration.load()
        except (LinkError, NotNow) as error:
            self._note("warning", "config-load-failed", f"configuration not loaded: {error}", who)
            if isinstance(error, Unverified | MasterRefused):
                self._remember(who, "load", "EEPROM", "", NO_IMAGE, NO_IMAGE, _outcome(error))
            raise
        changed = _in_words(difference(before, image)) or "nothing changed"
        self._note("info", "config-loaded", f"configuration loaded from the EEPROM: {changed}", who)
        self._remember(who, "load", "EEPROM", "", before, image, "done")
        return image

    def command(self, name: str, command: Command, who: str, details: str = "") -> None:
        """Send a named command, noted with its outcome."""
        text = f"{name} {details}".strip()
        try:
            self._links.master.request(command)
        except LinkError as error:
            self._note("warning", "command-failed", f"{text}: {error}", who)
            raise
        self._note("info", "command", text, who)

    def stream(self, who: str, *, on: bool) -> None:
        """Start or stop the master's stream."""
        self._links.stream(on=on)
        self._note("info", "command", "stream-start" if on else "stream-stop", who)

    def _remember(
        self, who: str, action: Action, source: str, reason: str, before: bytes, after: bytes, result: str
    ) -> None:
        try:
            self._history.append(self._clock.wall_ns(), who, action, source, reason.strip(), before, after, result)
        except OSError as error:
            self._note("warning", "config-history-failed", f"this write is not in the history: {error}", who)


def _outcome(error: LinkError | NotNow) -> str:
    if isinstance(error, Unverified):
        in_force = {"old": "the old one is in force", "new": "the new one is in force"}.get(
            error.outcome, "neither the old nor the new one is in force" if error.outcome == "other" else "not known"
        )
        return f"not verified, {in_force}: {error}"
    return str(error)


def _in_words(changes: list[Change]) -> str:
    shown = [
        f"{c.field}{'' if c.element is None else f'[{c.element}]'} {c.before} -> {c.after} {c.unit}".rstrip()
        for c in changes[:8]
    ]
    return ", ".join(shown) + (f" and {len(changes) - 8} more" if len(changes) > 8 else "")
