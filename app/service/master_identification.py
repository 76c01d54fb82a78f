"""A master that appears, or starts again, is asked who it is and what it has stored."""

import contextlib
import logging
import time
from concurrent.futures import Executor

from app.configuration.safe_write import Configuration
from app.errors import AppError
from app.sources.master.client import MasterClient
from firmware_protocol.messages import EventCode, MessageType

log = logging.getLogger(__name__)
AGAIN_S = 10.0  # a master that does not know IDENT is not asked at every frame
NEWS = (bytes([EventCode.BOOT]), bytes([EventCode.CONFIG_STORED]))


class Greeter:
    """Hears every frame in the pipeline's thread; asks in a job of its own, since an answer takes its time."""

    def __init__(self, master: MasterClient, configuration: Configuration, jobs: Executor) -> None:
        self._master = master
        self._configuration = configuration
        self._jobs = jobs
        self._is_done = False
        self._not_before_ns = 0

    def forget(self) -> None:
        """The link went down: whoever speaks next is a stranger."""
        self._is_done, self._not_before_ns = False, 0

    def heard(self, frame_type: int, body: bytes) -> None:
        """Ask where the speaker is not known, or has news."""
        if frame_type == MessageType.EVENT and body[:1] in NEWS:
            self.forget()
        if not self._is_done and time.monotonic_ns() >= self._not_before_ns:
            self._is_done = True
            with contextlib.suppress(RuntimeError):  # shutting down
                self._jobs.submit(self._greet)

    def _greet(self) -> None:
        try:
            self._master.identify()
            self._configuration.read_stored()
        except AppError as error:
            log.info("the master did not introduce itself: %s", error)
            self._not_before_ns = time.monotonic_ns() + int(AGAIN_S * 1e9)
            self._is_done = False
