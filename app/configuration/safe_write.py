"""The safe write: read, compare, check, write, read back byte for byte; store, read the EEPROM back.

Blocking; one write at a time.
"""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from app.clock import Clock
from app.configuration.history import Action
from app.configuration.issue import ConfigIssue
from app.configuration.rules import Context, review_change
from app.configuration.write_log import Attempt, WriteLog
from app.errors import AppError, LinkError, LinkLost, MasterRefused, MasterSilent, NotNow, message_of
from app.sources.master.client import MasterClient, read_field
from app.words import Message, Quantity, render
from firmware_protocol.can_tables import RxMessage, TxMessage, with_rx_messages, with_tx_messages
from firmware_protocol.config_image import Change, difference, image_hash, with_raw, with_value
from firmware_protocol.eeprom import EEPROM_SIZE, SLOT_OFFSETS, SLOT_SIZE, StoredConfig, newest
from firmware_protocol.memory_map import CONFIG, CONFIG_SIZE, FIELDS, STATUS_FLAGS
from firmware_protocol.messages import EEPROM_READ_BASE, Load, Store, Write

MAX_SHOWN = 64
SENSOR_FIELDS = {"i_offset", "i_gain"}
REST_A = 2.0  # more than the sensor's noise
LINE_BROKE = (LinkLost, MasterSilent)  # the request may or may not have been done


#: that a write may change while the accumulator drives, charges or balances
FIELDS_WRITABLE_AT_WORK = tuple(name for name, field in CONFIG.items() if field.is_live)


class HashMismatch(AppError):
    """The configuration in force is not the one that the draft started from; `wanted` is what it would have become."""

    def __init__(self, expected: str, base: bytes | None, in_force: bytes, wanted: bytes) -> None:
        self.expected = expected
        self.base = base  # what the draft started from, where it is still known
        self.in_force = in_force
        self.wanted = wanted
        super().__init__(Message("hash-mismatch", in_force=image_hash(in_force), expected=expected))


class Rejected(AppError):
    """The draft breaks limits."""

    def __init__(self, findings: list[ConfigIssue]) -> None:
        self.findings = findings
        super().__init__(Message("list", shown=tuple(issue.message for issue in findings)))


class ReasonRequired(AppError):
    """The draft has warnings, and no reason is given."""

    def __init__(self, findings: list[ConfigIssue]) -> None:
        self.findings = findings
        super().__init__(Message("reason-needed", findings=tuple(issue.message for issue in findings)))


class Busy(NotNow):
    """The accumulator is at work, and the draft changes more than what may change meanwhile."""

    def __init__(self, doing: Message, fields: list[str]) -> None:
        self.doing = render(doing)
        self.fields = fields
        super().__init__(
            Message("only-at-rest", doing=doing, fields=tuple(fields), live=tuple(FIELDS_WRITABLE_AT_WORK))
        )


class Unverified(LinkError):
    """A write was sent and what is in force afterwards is not what was sent."""

    def __init__(self, outcome: str, detail: Message) -> None:
        self.outcome = outcome  # old | other | unknown
        super().__init__(detail)


@dataclass(frozen=True, slots=True)
class Written:
    """A finished write, or with `written` False only what it would be."""

    before: bytes
    image: bytes
    changes: list[Change]
    findings: list[ConfigIssue]
    block_reason: Message | None  # why it would be refused now
    written: bool


@dataclass(frozen=True, slots=True)
class Draft:
    """A configuration that somebody wants active, the reason for its warnings, and its origin."""

    base: bytes | None = None  # the image that it starts from; None: the one that the write finds in force
    values: Mapping[str, Any] = field(default_factory=dict)  # fields to change, in units
    raw: Mapping[str, Any] = field(default_factory=dict)  # and in counts
    can_sent: Sequence[TxMessage] = ()  # messages to replace, by their index
    can_received: Sequence[RxMessage] = ()
    reason: str = ""
    source: str = "draft"
    action: Action = "write"

    def applied_to(self, in_force: bytes) -> bytes:
        """Return the image that is wanted.

        Raises:
            EncodeError: there is no such field, or a value does not fit it.
        """
        image = in_force if self.base is None else self.base
        for name, value in self.values.items():
            image = with_value(image, name, value)
        for name, count in self.raw.items():
            image = with_raw(image, name, count)
        if self.can_sent:
            image = with_tx_messages(image, self.can_sent)
        return with_rx_messages(image, self.can_received) if self.can_received else image


class ConfigurationWriter:
    """The configuration in force and the stored one, through the master client."""

    def __init__(
        self,
        master: MasterClient,
        context: Callable[[], Context],
        log: WriteLog,
        clock: Clock,
    ) -> None:
        self._master = master
        self._context = context
        self._log = log
        self._clock = clock
        self._one_editor = threading.Lock()
        self.last_read: tuple[int, bytes] | None = None  # monotonic ns, what was in force
        self.stored: StoredConfig | None = None
        self._one_reader = threading.Lock()
        self._reads_begun = 0  # number of EEPROM reads begun
        self._read_failed: AppError | None = None  # the last of them
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
        asked_ns = self._clock.monotonic_ns()
        image = self._master.read(0, CONFIG_SIZE)
        self.last_read = asked_ns, image
        return image

    def read_stored(self) -> StoredConfig | None:
        """Return what the EEPROM holds, None where no slot is valid.

        Whoever asks during a read shares the next one: every open page asks after a change, and the line and its few
        places for requests are left to who writes.

        Raises:
            LinkError: the master cannot be asked.
            NotNow: too many requests are waiting.
        """
        begun_before = self._reads_begun
        with self._one_reader:
            if self._reads_begun == begun_before:
                self._reads_begun += 1
                self._read_failed = None
                try:
                    self.stored = self._read_eeprom()
                except (LinkError, NotNow) as error:
                    self._read_failed = error
            if self._read_failed is not None:
                raise self._read_failed
            return self.stored

    def _read_eeprom(self) -> StoredConfig | None:
        memory = bytearray(EEPROM_SIZE)
        for offset in SLOT_OFFSETS:
            memory[offset : offset + SLOT_SIZE] = self._master.read(EEPROM_READ_BASE + offset, SLOT_SIZE)
        return newest(bytes(memory))

    def write(self, draft: Draft, expected: str, who: str, *, dry_run: bool) -> Written:
        """Write a draft and read it back.

        Args:
            draft: what is wanted, why, and where it is from.
            expected: hash of the image that the draft was made from; another one in force refuses the write.
            who: for the event log and the history.
            dry_run: only read, compare and check.

        Raises:
            EncodeError, HashMismatch, Rejected, ReasonRequired, Busy: nothing was written.
            NotNow: another write is running, or the master's memory map is another one.
            RecordingFailed: the history does not take it; nothing was written.
            MasterRefused: the master refused; nothing was written.
            Unverified: link lost or master reset; says what is in force now.
            LinkError: the master cannot be asked; nothing was written.
        """
        attempt = Attempt(who, draft.action, draft.source, draft.reason)
        with self._editing(attempt, is_logged=not dry_run):
            # Read what is in force, and compare: is it what the draft was made from?
            before = attempt.before = self.read()
            wanted = attempt.after = draft.applied_to(before)
            if expected not in ("*", image_hash(before)):
                raise HashMismatch(expected, self._shown.get(expected), before, wanted)

            # Check the draft against the limits of its fields and the rules, and the accumulator's state
            stored = None if self.stored is None else self.stored.image
            findings = review_change(before, wanted, self._context(), stored)
            if errors := [issue for issue in findings if issue.blocks]:
                raise Rejected(errors)
            changes = difference(before, wanted)
            if dry_run or not changes:
                return Written(before, wanted, changes, findings, self._block_reason(changes), written=False)
            self._require_same_map()
            if not draft.reason.strip() and (asked := [issue for issue in findings if issue.needs_reason]):
                raise ReasonRequired(asked)
            self._require_rest(changes)

            # Say so first, write, read back byte for byte, and record the outcome
            self._log.begun(attempt)
            try:
                self._master.request(Write(0, wanted))
            except LINE_BROKE as error:
                raise self._unverified(error, before, wanted) from error
            self._require_in_force(before, wanted)
            self._log.written(attempt, changes)
            return Written(before, wanted, changes, findings, None, written=True)

    def store(self, who: str) -> StoredConfig:
        """Store the configuration in force and read the EEPROM back.

        Raises:
            Unverified: the EEPROM does not hold what is in force.
            NotNow: another write is running, or the master's memory map is another one.
            MasterRefused, LinkError: see MasterClient.request.
        """
        attempt = Attempt(who, "store", "in force")
        if (stored_before := self.stored) is not None:
            attempt.before = stored_before.image
        with self._editing(attempt):
            self._require_same_map()
            in_force = attempt.after = self.read()
            self._log.begun(attempt)
            self._master.request(Store())
            stored = self.read_stored()
            if stored is None or stored.image != in_force:
                raise Unverified("other", Message("eeprom-differs"))
            attempt.after = stored.image
            self._log.stored(attempt)
            return stored

    def load(self, who: str) -> bytes:
        """Put the stored configuration in force and return it.

        Raises:
            NotNow: nothing is stored, the accumulator is at work, or the memory map is another one.
            Unverified: link lost or master reset; says what is in force now.
            MasterRefused, LinkError: see MasterClient.request; nothing was changed.
        """
        attempt = Attempt(who, "load", "EEPROM")
        with self._editing(attempt):
            self._require_same_map()
            before, stored = self.read(), self.read_stored()
            if stored is None:
                raise NotNow(Message("nothing-stored"))
            changes = difference(before, stored.image)
            self._require_rest(changes)
            attempt.before, attempt.after = before, stored.image
            self._log.begun(attempt)
            try:
                self._master.request(Load())
            except LINE_BROKE as error:
                raise self._unverified(error, before, stored.image) from error
            self._require_in_force(before, stored.image)
            self._log.loaded(attempt, changes)
            return stored.image

    @contextmanager
    def _editing(self, attempt: Attempt, *, is_logged: bool = True) -> Iterator[None]:
        """One at a time; what fails is in the log."""
        has_lock = self._one_editor.acquire(blocking=False)
        try:
            if not has_lock:
                raise NotNow(Message("another-is-running"))  # noqa: TRY301  it is logged as every other failure
            yield
        except (LinkError, NotNow) as error:
            if is_logged:
                self._log.failed(attempt, error, _result(error))
            raise
        finally:
            if has_lock:
                self._one_editor.release()

    def _unverified(self, error: Exception, before: bytes, wanted: bytes) -> Unverified:
        return Unverified(self._outcome(before, wanted), Message("read-again", error=message_of(error)))

    def _require_in_force(self, before: bytes, wanted: bytes) -> None:
        """Read back what is in force, and compare every byte."""
        try:
            in_force = self.read()
        except (LinkError, NotNow) as error:
            raise Unverified(self._outcome(before, wanted), Message("not-read-back", error=error.message)) from error
        if in_force != wanted:
            raise Unverified("old" if in_force == before else "other", Message("not-taken"))

    def _outcome(self, before: bytes, wanted: bytes) -> str:
        try:
            in_force = self.read()
        except (LinkError, NotNow):
            return "unknown"
        return {before: "old", wanted: "new"}.get(in_force, "other")

    def _require_rest(self, changes: list[Change]) -> None:
        fields = sorted({change.field for change in changes} - set(FIELDS_WRITABLE_AT_WORK))
        if fields and (doing := self._doing(sensor_only=set(fields) <= SENSOR_FIELDS)) is not None:
            raise Busy(doing, fields)

    def _block_reason(self, changes: list[Change]) -> Message | None:
        """Why the changes would be refused now."""
        try:
            self._require_same_map()
            self._require_rest(changes)
        except NotNow as error:
            return error.message
        return None

    def _doing(self, *, sensor_only: bool) -> Message | None:
        """What the accumulator does that forbids a change, asked of the master itself; None at rest.

        With relays open no current flows, whatever a sensor says that is about to be calibrated.
        """
        (bits,) = read_field(self._master, "status.flags")
        flags = {name for bit, name in enumerate(STATUS_FLAGS) if bits >> bit & 1}
        current_a = read_field(self._master, "i_fs")[0] * FIELDS["i_fs"].scale
        if "charging" in flags:
            return Message("being-charged")
        if "load" in flags:
            return Message("relays-are-closed")
        if abs(current_a) > REST_A and not sensor_only:
            return Message("current-flows", current=Quantity(current_a, "A", 1))
        return None

    def _require_same_map(self) -> None:
        identity = self._master.identity
        if identity is None:
            raise NotNow(Message("map-not-known"))
        if not identity.is_compatible:
            raise NotNow(Message("map-differs", map_hash=identity.map_hash))


def _result(error: LinkError | NotNow) -> str | None:
    """What the history says of a failed change; None where the master was asked for nothing."""
    if isinstance(error, Unverified):
        in_force = {"old": "the old one is in force", "new": "the new one is in force"}.get(
            error.outcome, "neither the old nor the new one is in force" if error.outcome == "other" else "not known"
        )
        return f"not verified, {in_force}: {error}"
    return str(error) if isinstance(error, MasterRefused) else None
