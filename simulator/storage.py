"""The firmware's use of its EEPROM: configuration slots and the Coulomb counter's journal, one page write at a time."""

import numpy as np

from firmware_protocol.config_image import check
from firmware_protocol.eeprom import JournalEntry, journal_write, newest, newest_journal, plan_store, valid_slots
from firmware_protocol.messages import NO_OFFSET, EventCode, EventMessage, MessageType, Reply, Result
from simulator.eeprom import Eeprom, PageJob

JOURNAL_PERIOD_S = 10.0
JOURNAL_STEP_UAH = 25_000  # 0.1 % of 25 Ah: less is not worth a page


class ConfigStore:
    """Slots and journal; a store writes page by page while the other tasks run."""

    def __init__(self, eeprom: Eeprom, now_s: float) -> None:
        self._eeprom = eeprom
        self._job: PageJob | None = None
        self._sequence = 0
        self._image = b""
        self._journal = newest_journal(bytes(eeprom.content))
        self._journal_due_s = now_s + JOURNAL_PERIOD_S

    @property
    def is_busy(self) -> bool:
        """The chip is being written."""
        return self._job is not None

    @property
    def journal(self) -> JournalEntry | None:
        """The newest stored count."""
        return self._journal

    def config_at_start(self) -> bytes | None:
        """Return the newest stored configuration that passes the check, None without one."""
        return next((slot.image for slot in valid_slots(bytes(self._eeprom.content)) if not check(slot.image)), None)

    def start(self, sequence: int, image: bytes, now_s: float) -> bool:
        """Begin to write a configuration to the older slot for the request `sequence`; False while one is under way."""
        if self.is_busy:
            return False
        pages = [(page.offset, page.data) for page in plan_store(bytes(self._eeprom.content), image)]
        self._job, self._sequence, self._image = PageJob(self._eeprom, pages, now_s), sequence, image
        return True

    def run(self, now_s: float) -> tuple[Reply, EventMessage | None] | None:
        """Write the next page; return the reply and the event once the configuration has been read back."""
        if self._job is None or not self._job.run(now_s):
            return None
        self._job = None
        stored = newest(bytes(self._eeprom.content))
        if stored is None or stored.image != self._image:
            return Reply(MessageType.STORE, self._sequence, Result.EEPROM_FAILED), None
        event = EventMessage(EventCode.CONFIG_STORED, 0, NO_OFFSET, stored.counter, 0)
        return Reply(MessageType.STORE, self._sequence, Result.DONE), event

    def remember(self, dod: int, soc: int, now_s: float) -> None:
        """Write the count to the journal, every ten seconds if it has moved."""
        if now_s < self._journal_due_s or self.is_busy:
            return
        self._journal_due_s = now_s + JOURNAL_PERIOD_S
        if self._journal is not None and abs(self._journal.dod_raw - dod) < JOURNAL_STEP_UAH:
            return
        page = journal_write(self._journal, dod, soc)
        self._eeprom.write(page.offset, page.data)
        counter = 1 if self._journal is None else self._journal.counter + 1
        self._journal = JournalEntry(counter, dod, soc)

    def lose_power(self, rng: np.random.Generator) -> None:
        """Interrupt the page write that is running."""
        if self._job is not None:
            self._job.interrupt(rng)
            self._job = None
