"""The newest value, from the thread that makes it to the event loop that its readers live on."""

import asyncio
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Hub(Generic[T]):
    """Publishes on the event loop; `publish_threadsafe` may be called from any thread."""

    def __init__(self) -> None:
        self.latest: T | None = None
        self._listeners: list[Callable[[T], None]] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._lock = threading.Lock()
        self._is_due = False

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Name the loop that the listeners are called on."""
        self._loop = loop

    def listen(self, listener: Callable[[T], None]) -> None:
        """Call `listener` with what is published from now on."""
        self._listeners.append(listener)

    def publish_threadsafe(self, value: T) -> None:
        """Publish a value from another thread; without a running loop it only becomes the latest.

        While the loop has not come round to the one before, only the newest waits for it.
        """
        with self._lock:
            self.latest = value
            if self._is_due or self._loop is None or self._loop.is_closed():
                return
            self._is_due = True
            self._loop.call_soon_threadsafe(self._publish_latest)

    def _publish_latest(self) -> None:
        with self._lock:
            self._is_due = False
            value = self.latest
        if value is not None:
            for listener in self._listeners:
                listener(value)
