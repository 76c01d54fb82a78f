"""The safe write: read, compare, check, write, read back byte for byte; store, read the EEPROM back.

Blocking; one write at a time.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from app.errors import AppError, LinkError, LinkLost, MasterSilent, NotNow
from app.links.master import MasterClient
from app.telemetry import Identity
from firmware_protocol.config_image import Change, FieldError, check, difference, image_hash
from firmware_protocol.eeprom import EEPROM_SIZE, SLOT_OFFSETS, SLOT_SIZE, StoredConfig, newest
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.messages import EEPROM_READ_BASE


class HashMismatch(AppError):
    """The configuration in force is not the one that the draft started from."""

    def __init__(self, expected: str, in_force: bytes) -> None:
        self.expected = expected
        self.in_force = in_force
        super().__init__(f"the configuration in force is {image_hash(in_force)}, not {expected}")


class Rejected(AppError):
    """The draft breaks limits."""

    def __init__(self, errors: list[FieldError]) -> None:
        self.errors = errors
        super().__init__("; ".join(error.message for error in errors))


class Unverified(LinkError):
    """A write was sent and what is in force afterwards is not what was sent."""

    def __init__(self, outcome: str, detail: str) -> None:
        self.outcome = outcome  # old | other | unknown
        super().__init__(detail)


@dataclass(frozen=True, slots=True)
class Written:
    """A finished write, or with `written` False only its difference."""

    image: bytes
    changes: list[Change]
    written: bool


class Configuration:
    """The configuration in force and the stored one, through the master client."""

    def __init__(self, master: MasterClient, identity: Callable[[], Identity | None]) -> None:
        self._master = master
        self._identity = identity
        self._one_editor = threading.Lock()
        self.last_read: tuple[int, bytes] | None = None  # monotonic ns, what was in force
        self.stored: StoredConfig | None = None
        self.stored_is_known = False

    def read(self) -> bytes:
        """Return the 420 bytes in force.

        Raises:
            LinkError: the master cannot be asked.
        """
        asked_ns = time.monotonic_ns()
        image = self._master.read(0, CONFIG_SIZE)
        self.last_read = asked_ns, image
        return image

    def read_stored(self) -> StoredConfig | None:
        """Return what the EEPROM holds, None where no slot is valid.

        Raises:
            LinkError: the master cannot be asked.
        """
        memory = bytearray(EEPROM_SIZE)
        for offset in SLOT_OFFSETS:
            memory[offset : offset + SLOT_SIZE] = self._master.read(EEPROM_READ_BASE + offset, SLOT_SIZE)
        self.stored = newest(bytes(memory))
        self.stored_is_known = True
        return self.stored

    def write(self, edit: Callable[[bytes], bytes], expected_hash: str, *, dry_run: bool) -> Written:
        """Apply an edit to the configuration in force and verify it.

        Args:
            edit: image in force -> image wanted.
            expected_hash: of the image that the edit was made from; another one in force refuses the write.
            dry_run: only check and compare.

        Raises:
            HashMismatch, Rejected: nothing was written.
            NotNow: another write is running, or the master's memory map is another one.
            MasterRefused: the master refused; nothing was written.
            Unverified: link lost or master reset; says what is in force now.
            LinkError: the master cannot be asked; nothing was written.
        """
        with self._editing():
            before = self.read()
            if expected_hash not in ("*", image_hash(before)):
                raise HashMismatch(expected_hash, before)
            wanted = edit(before)
            if errors := check(wanted):
                raise Rejected(errors)
            changes = difference(before, wanted)
            if dry_run or not changes:
                return Written(wanted, changes, written=False)
            self._require_same_map()
            self._write_and_verify(before, wanted)
            return Written(wanted, changes, written=True)

    def store(self) -> StoredConfig:
        """Store the configuration in force and read the EEPROM back.

        Raises:
            Unverified: the EEPROM does not hold what is in force.
            MasterRefused, LinkError: see MasterClient.request.
        """
        with self._editing():
            self._require_same_map()
            in_force = self.read()
            self._master.store()
            stored = self.read_stored()
            if stored is None or stored.image != in_force:
                raise Unverified("other", "the EEPROM does not hold the configuration in force")
            return stored

    def load(self) -> bytes:
        """Put the stored configuration in force and return it."""
        with self._editing():
            self._master.load()
            return self.read()

    @contextmanager
    def _editing(self) -> Iterator[None]:
        if not self._one_editor.acquire(blocking=False):
            raise NotNow("another write, store or load is running")
        try:
            yield
        finally:
            self._one_editor.release()

    def _write_and_verify(self, before: bytes, wanted: bytes) -> None:
        try:
            self._master.write(0, wanted)
        except (LinkLost, MasterSilent) as error:
            raise Unverified(self._outcome(before, wanted), f"{error}; what is in force was read again") from error
        try:
            in_force = self.read()
        except (LinkError, NotNow) as error:
            raise Unverified(self._outcome(before, wanted), f"written, not read back: {error}") from error
        if in_force != wanted:
            raise Unverified("old" if in_force == before else "other", "the master did not take the configuration")

    def _outcome(self, before: bytes, wanted: bytes) -> str:
        try:
            in_force = self.read()
        except (LinkError, NotNow):
            return "unknown"
        return {before: "old", wanted: "new"}.get(in_force, "other")

    def _require_same_map(self) -> None:
        identity = self._identity()
        if identity is None:
            raise NotNow("the master has not said which memory map it uses")
        if not identity.is_compatible:
            raise NotNow(f"the master's memory map {identity.map_hash} is not this program's; writes are refused")
