"""The safe write: read, compare, check, write, read back byte for byte; store, read the EEPROM back.

Blocking; one write at a time.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from app.configuration.finding import Finding
from app.configuration.rules import Context, review_change
from app.errors import AppError, LinkError, LinkLost, MasterSilent, NotNow
from app.sources.master.client import MasterClient
from app.telemetry import Identity
from firmware_protocol.config_image import Change, difference, image_hash
from firmware_protocol.eeprom import EEPROM_SIZE, SLOT_OFFSETS, SLOT_SIZE, StoredConfig, newest
from firmware_protocol.memory_map import CONFIG, CONFIG_SIZE, FIELDS, STATUS_FLAGS
from firmware_protocol.messages import EEPROM_READ_BASE


class HashMismatch(AppError):
    """The configuration in force is not the one that the draft started from; `wanted` is what it would have become."""

    def __init__(self, expected: str, base: bytes | None, in_force: bytes, wanted: bytes) -> None:
        self.expected = expected
        self.base = base  # what the draft started from, where it is still known
        self.in_force = in_force
        self.wanted = wanted
        super().__init__(f"the configuration in force is {image_hash(in_force)}, not {expected}")


class Rejected(AppError):
    """The draft breaks limits."""

    def __init__(self, findings: list[Finding]) -> None:
        self.findings = findings
        super().__init__("; ".join(found.error.message for found in findings))


class ReasonRequired(AppError):
    """The draft has warnings, and nobody said why it is right all the same."""

    def __init__(self, findings: list[Finding]) -> None:
        self.findings = findings
        super().__init__("a reason is needed: " + "; ".join(found.error.message for found in findings))


class Occupied(NotNow):
    """The accumulator is at work, and the draft changes more than what may change meanwhile."""

    def __init__(self, doing: str, fields: list[str]) -> None:
        self.doing = doing
        self.fields = fields
        super().__init__(
            f"{doing}: {', '.join(fields)} may only be changed with relays open and no current; "
            f"at work may change: {', '.join(LIVE_FIELDS)}"
        )


class Unverified(LinkError):
    """A write was sent and what is in force afterwards is not what was sent."""

    def __init__(self, outcome: str, detail: str) -> None:
        self.outcome = outcome  # old | other | unknown
        super().__init__(detail)


LIVE_FIELDS = [name for name, field in CONFIG.items() if field.is_live]
MAX_SHOWN = 64
SENSOR_FIELDS = {"i_offset", "i_gain"}
REST_A = 2.0  # more than the sensor's noise


@dataclass(frozen=True, slots=True)
class Written:
    """A finished write, or with `written` False only what it would be."""

    before: bytes
    image: bytes
    changes: list[Change]
    findings: list[Finding]
    hindrance: str | None  # why it would be refused now
    written: bool


class Configuration:
    """The configuration in force and the stored one, through the master client."""

    def __init__(
        self, master: MasterClient, identity: Callable[[], Identity | None], context: Callable[[], Context]
    ) -> None:
        self._master = master
        self._identity = identity
        self._context = context
        self._one_editor = threading.Lock()
        self.last_read: tuple[int, bytes] | None = None  # monotonic ns, what was in force
        self.stored: StoredConfig | None = None
        self.stored_is_known = False
        self._shown: dict[str, bytes] = {}

    def show(self, image: bytes) -> str:
        """Remember an image that a draft may start from, and return its hash."""
        name = image_hash(image)
        self._shown.pop(name, None)
        self._shown[name] = image
        while len(self._shown) > MAX_SHOWN:
            self._shown.pop(next(iter(self._shown)), None)
        return name

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

    def write(self, edit: Callable[[bytes], bytes], expected_hash: str, *, dry_run: bool, reason: str = "") -> Written:
        """Apply an edit to the configuration in force and verify it.

        Args:
            edit: image in force -> image wanted.
            expected_hash: of the image that the edit was made from; another one in force refuses the write.
            dry_run: only check and compare.
            reason: why it is right in spite of warnings.

        Raises:
            HashMismatch, Rejected, ReasonRequired, Occupied: nothing was written.
            NotNow: another write is running, or the master's memory map is another one.
            MasterRefused: the master refused; nothing was written.
            Unverified: link lost or master reset; says what is in force now.
            LinkError: the master cannot be asked; nothing was written.
        """
        with self._editing():
            before = self.read()
            wanted = edit(before)
            if expected_hash not in ("*", image_hash(before)):
                raise HashMismatch(expected_hash, self._shown.get(expected_hash), before, wanted)
            findings = review_change(before, wanted, self._context())
            if errors := [found for found in findings if found.blocks]:
                raise Rejected(errors)
            changes = difference(before, wanted)
            if dry_run or not changes:
                return Written(before, wanted, changes, findings, self._hindrance(changes), written=False)
            self._require_same_map()
            if not reason.strip() and (asked := [found for found in findings if found.needs_reason]):
                raise ReasonRequired(asked)
            self._require_rest(changes)
            self._and_verify(lambda: self._master.write(0, wanted), before, wanted)
            return Written(before, wanted, changes, findings, None, written=True)

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

    def load(self) -> tuple[bytes, bytes]:
        """Put the stored configuration in force and return what was in force and what is.

        Raises:
            NotNow: nothing is stored, the accumulator is at work, or the memory map is another one.
            Unverified: link lost or master reset; says what is in force now.
            MasterRefused, LinkError: see MasterClient.request; nothing was changed.
        """
        with self._editing():
            self._require_same_map()
            before, stored = self.read(), self.read_stored()
            if stored is None:
                raise NotNow("the EEPROM holds no valid configuration")
            self._require_rest(difference(before, stored.image))
            self._and_verify(self._master.load, before, stored.image)
            return before, stored.image

    @contextmanager
    def _editing(self) -> Iterator[None]:
        if not self._one_editor.acquire(blocking=False):
            raise NotNow("another write, store or load is running")
        try:
            yield
        finally:
            self._one_editor.release()

    def _and_verify(self, change: Callable[[], None], before: bytes, wanted: bytes) -> None:
        """Change what is in force, and read it back."""
        try:
            change()
        except (LinkLost, MasterSilent) as error:
            raise Unverified(self._outcome(before, wanted), f"{error}; what is in force was read again") from error
        try:
            in_force = self.read()
        except (LinkError, NotNow) as error:
            raise Unverified(self._outcome(before, wanted), f"done, but not read back: {error}") from error
        if in_force != wanted:
            raise Unverified("old" if in_force == before else "other", "the master did not take the configuration")

    def _outcome(self, before: bytes, wanted: bytes) -> str:
        try:
            in_force = self.read()
        except (LinkError, NotNow):
            return "unknown"
        return {before: "old", wanted: "new"}.get(in_force, "other")

    def _require_rest(self, changes: list[Change]) -> None:
        fields = sorted({change.field for change in changes} - set(LIVE_FIELDS))
        if fields and (doing := self._doing(sensor_only=set(fields) <= SENSOR_FIELDS)) is not None:
            raise Occupied(doing, fields)

    def _hindrance(self, changes: list[Change]) -> str | None:
        """Why the changes would be refused now."""
        try:
            self._require_same_map()
            self._require_rest(changes)
        except NotNow as error:
            return str(error)
        return None

    def _doing(self, *, sensor_only: bool) -> str | None:
        """What the accumulator does that forbids a change, asked of the master itself; None at rest.

        With relays open no current flows, whatever a sensor says that is about to be calibrated.
        """
        flags_field, current = FIELDS["status.flags"], FIELDS["i_fs"]
        (bits,) = flags_field.unpack(self._master.read(flags_field.offset, flags_field.size), -flags_field.offset)
        flags = {name for bit, name in enumerate(STATUS_FLAGS) if bits >> bit & 1}
        (raw,) = current.unpack(self._master.read(current.offset, current.size), -current.offset)
        if "charging" in flags:
            return "the accumulator is being charged"
        if "load" in flags:
            return "the relays are closed"
        if abs(raw * current.scale) > REST_A and not sensor_only:
            return f"a current of {raw * current.scale:.1f} A flows"
        return None

    def _require_same_map(self) -> None:
        identity = self._identity()
        if identity is None:
            raise NotNow("the master has not said which memory map it uses")
        if not identity.is_compatible:
            raise NotNow(f"the master's memory map {identity.map_hash} is not this program's; writes are refused")
