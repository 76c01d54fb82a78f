"""What people do to the master, each with its outcome in the event log: who, what, result."""

from collections.abc import Callable
from typing import Protocol

from app.configuration import Configuration, Written
from app.errors import LinkError, LinkLost, NotNow
from app.links.master import MasterClient
from app.links.serial import SerialLink
from firmware_protocol.config_image import Change, image_hash
from firmware_protocol.eeprom import StoredConfig
from firmware_protocol.messages import Command


class Note(Protocol):
    """Writes a line into the event log."""

    def __call__(self, severity: str, code: str, text: str, who: str | None = None) -> None:
        """Write it."""


class Operator:
    """Carries out what a user asked for. Blocking; thread-safe."""

    def __init__(
        self, configuration: Configuration, master: MasterClient, serial: SerialLink | None, note: Note
    ) -> None:
        self._configuration = configuration
        self._master = master
        self._serial = serial
        self._note = note

    def write_config(self, edit: Callable[[bytes], bytes], expected: str, who: str, *, dry_run: bool) -> Written:
        """Configuration.write, with its outcome in the event log."""
        try:
            written = self._configuration.write(edit, expected, dry_run=dry_run)
        except (LinkError, NotNow) as error:
            if not dry_run:
                self._note("warning", "config-write-failed", f"configuration not written: {error}", who)
            raise
        if written.written:
            self._note("info", "config-written", "configuration written: " + _in_words(written.changes), who)
        return written

    def store_config(self, who: str) -> StoredConfig:
        """Configuration.store, with its outcome in the event log."""
        try:
            stored = self._configuration.store()
        except (LinkError, NotNow) as error:
            self._note("warning", "config-store-failed", f"configuration not stored: {error}", who)
            raise
        self._note("info", "config-stored", f"configuration {image_hash(stored.image)} stored in the EEPROM", who)
        return stored

    def load_config(self, who: str) -> bytes:
        """Configuration.load, noted in the event log."""
        image = self._configuration.load()
        self._note("info", "config-loaded", f"configuration {image_hash(image)} loaded from the EEPROM", who)
        return image

    def command(self, name: str, command: Command, who: str) -> None:
        """Send a named command, noted with its outcome."""
        try:
            self._master.request(command)
        except LinkError as error:
            self._note("warning", "command-failed", f"{name}: {error}", who)
            raise
        self._note("info", "command", f"{name} {command.argument}" if command.argument else name, who)

    def stream(self, who: str, *, on: bool) -> None:
        """Start or stop the master's stream."""
        if self._serial is None:
            raise LinkLost("no RS232 port is configured")
        self._serial.stream(on=on)
        self._note("info", "command", "stream-start" if on else "stream-stop", who)


def _in_words(changes: list[Change]) -> str:
    shown = [
        f"{c.field}{'' if c.element is None else f'[{c.element}]'} {c.before} -> {c.after} {c.unit}".rstrip()
        for c in changes[:8]
    ]
    return ", ".join(shown) + (f" and {len(changes) - 8} more" if len(changes) > 8 else "")
