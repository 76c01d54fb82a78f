"""A master that appears, or starts again, is asked who it is and what it has stored."""

import contextlib
import logging
from concurrent.futures import Executor

from app.clock import Clock
from app.configuration.safe_write import ConfigurationWriter
from app.errors import AppError
from app.sources.items import Item, LinkChange, SerialItem
from app.sources.master.client import MasterClient
from firmware_protocol.framing import BadFrame, Frame
from firmware_protocol.messages import EventCode, MessageType

log = logging.getLogger(__name__)
AGAIN_S = 10.0  # a master that does not know IDENT is not asked at every frame
NEWS = (bytes([EventCode.BOOT]), bytes([EventCode.CONFIG_STORED]))


class MasterIdentification:
    """Sees every item in the pipeline's thread; asks in a job of its own, since an answer takes its time."""

    def __init__(self, master: MasterClient, configuration: ConfigurationWriter, jobs: Executor, clock: Clock) -> None:
        self._master = master
        self._configuration = configuration
        self._jobs = jobs
        self._clock = clock
        self._is_done = False
        self._not_before_ns = 0

    def on_item(self, item: Item) -> None:
        """Look at what the RS232 link delivered."""
        if isinstance(item, SerialItem) and not isinstance(item.frame, BadFrame):
            self._on_frame(item.frame)
        elif isinstance(item, LinkChange) and item.link == "rs232" and item.state != "open":
            self._start_over()  # the next frame may be another master's

    def _start_over(self) -> None:
        self._is_done, self._not_before_ns = False, 0

    def _on_frame(self, frame: Frame) -> None:
        """Ask where the sender is not known, or says that it started or stored."""
        if frame.type == MessageType.EVENT and frame.body[:1] in NEWS:
            self._start_over()
        if not self._is_done and self._clock.monotonic_ns() >= self._not_before_ns:
            self._is_done = True
            with contextlib.suppress(RuntimeError):  # shutting down
                self._jobs.submit(self._ask)

    def _ask(self) -> None:
        try:
            self._master.identify()
            self._configuration.read_stored()
        except AppError as error:
            log.info("the master did not introduce itself: %s", error)
            self._not_before_ns = self._clock.monotonic_ns() + int(AGAIN_S * 1e9)
            self._is_done = False
