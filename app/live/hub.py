"""Latest value to many readers: each has one slot, a slow reader misses values and delays nobody."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar, cast

T = TypeVar("T")


class Subscription(Generic[T]):
    """One reader's slot."""

    def __init__(self) -> None:
        self._value: T | None = None
        self._filled = asyncio.Event()
        self.skipped = 0

    def offer(self, value: T) -> None:
        """Put a value into the slot; one that was not taken is lost and counted."""
        if value is self._value:
            return
        if self._filled.is_set():
            self.skipped += 1
        self._value = value
        self._filled.set()

    async def next(self) -> T:
        """Wait for a value and take it."""
        await self._filled.wait()
        self._filled.clear()
        return cast(T, self._value)


class Hub(Generic[T]):
    """Publishes on the event loop; `publish_threadsafe` may be called from any thread."""

    def __init__(self) -> None:
        self.latest: T | None = None
        self._subscriptions: set[Subscription[T]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._lock = threading.Lock()
        self._is_due = False

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Name the loop that the readers live on."""
        self._loop = loop

    @property
    def readers(self) -> int:
        """How many are subscribed."""
        return len(self._subscriptions)

    def publish(self, value: T) -> None:
        """Offer a value to everyone."""
        self.latest = value
        for subscription in self._subscriptions:
            subscription.offer(value)

    def publish_threadsafe(self, value: T) -> None:
        """Offer a value from another thread; without a running loop it only becomes the latest.

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
            self.publish(value)

    @contextmanager
    def subscribe(self) -> Iterator[Subscription[T]]:
        """Join for the length of a with-block; the latest value, if any, is in the slot at once."""
        subscription: Subscription[T] = Subscription()
        if self.latest is not None:
            subscription.offer(self.latest)
        self._subscriptions.add(subscription)
        try:
            yield subscription
        finally:
            self._subscriptions.discard(subscription)
