"""The queue between the links' threads and the pipeline's: bounded, in order.

What comes in is handed to the recorder before it waits: a pipeline that is behind delays no recording. Where it is far
behind, what has waited longest is recorded alone, and not estimated. Where it stands still, no link waits for it: the
master's replies come through the same thread.
"""

import contextlib
import queue
import threading
from collections.abc import Callable

from app.sources.items import Item

SIZE = 4096  # beyond it a link waits, unless the oldest has waited for ...
LATE_S = 10.0  # ... so long, or nobody has taken anything for ...
STALL_S = 0.5  # ... so long: then the oldest makes room


class Inbox:
    """Many threads put, one gets."""

    def __init__(self, size: int = SIZE, record: Callable[[Item], None] = lambda item: None) -> None:
        self._record = record
        self._queue: queue.Queue[Item | None] = queue.Queue(size)
        self._closed = threading.Event()
        self._is_stalled = False  # a link waited in vain, and nothing was taken out since

    def put(self, item: Item) -> None:
        """Record an item and add it; wait a little while there is no room."""
        if not self._closed.is_set():
            self._record(item)
        while not self._closed.is_set():
            oldest_ns = self.oldest_ns if self._queue.full() else None
            is_late = oldest_ns is not None and item.t_mono_ns - oldest_ns > LATE_S * 1e9
            try:
                self._queue.put(item, timeout=0.0 if is_late or self._is_stalled else STALL_S)
            except queue.Full:
                if not self._closed.is_set():
                    self._is_stalled |= not is_late
                    with contextlib.suppress(queue.Empty):
                        self._queue.get_nowait()
            else:
                return

    def get(self, timeout_s: float) -> Item | None:
        """Return the oldest item; None where there is none within the time."""
        try:
            item = self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return None
        self._is_stalled = False
        return item

    @property
    def oldest_ns(self) -> int | None:
        """Return when the oldest item inside arrived, monotonic [ns]; None while it is empty."""
        with self._queue.mutex:
            item = self._queue.queue[0] if self._queue.queue else None
        return None if item is None else item.t_mono_ns

    def close(self) -> None:
        """Take no more items; those inside can still be taken out."""
        self._closed.set()
        with contextlib.suppress(queue.Full):
            self._queue.put_nowait(None)  # wakes a reader that waits

    @property
    def is_finished(self) -> bool:
        """The inbox is closed and empty."""
        return self._closed.is_set() and self._queue.empty()
