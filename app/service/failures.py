"""Items that the pipeline failed on: it goes on, the log says so, and health says so for a while."""

import logging
from collections.abc import Callable
from typing import TypeVar

from app.clock import Clock
from app.words import Message

log = logging.getLogger(__name__)
SHOWN_S = 60.0
T = TypeVar("T")


class Failures:
    """Counts them, from any thread."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._count = 0
        self._last: tuple[int, str] | None = None

    def add(self, error: Exception) -> None:
        """Count a failure; it is logged at most once a second."""
        now_ns = self._clock.monotonic_ns()
        self._count += 1
        if self._last is None or now_ns - self._last[0] > 1e9:
            log.error("the pipeline failed on an item and continues (failure %d)", self._count, exc_info=error)
        self._last = now_ns, f"{type(error).__name__}: {error}"

    def caught(self, work: Callable[[T], None]) -> Callable[[T], None]:
        """Return work that counts its failures and never raises."""

        def safe(value: T) -> None:
            try:
                work(value)
            except Exception as error:  # noqa: BLE001  what is not recorded is shown all the same
                self.add(error)

        return safe

    @property
    def reason(self) -> Message | None:
        """The last failure for a minute, None otherwise."""
        if self._last is None or self._clock.monotonic_ns() - self._last[0] >= SHOWN_S * 1e9:
            return None
        return Message("pipeline-failed", n=self._count, error=self._last[1])
