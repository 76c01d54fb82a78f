"""The last CAN frames, received and sent."""

import threading
from collections import deque
from dataclasses import dataclass

from app.sources.items import CanItem, Item

LENGTH = 20_000  # twenty seconds of a busy bus
MAX_IDS = 4096  # a bus with noise on its ids must not fill the memory


@dataclass(frozen=True, slots=True)
class TracedId:
    """One traced CAN id."""

    latest: CanItem
    count: int
    period_s: float | None
    changed: int  # bit mask of bytes that differ from the frame before


class CanTrace:
    """Bounded, thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._frames: deque[CanItem] = deque(maxlen=LENGTH)
        self._ids: dict[int, TracedId] = {}

    def on_item(self, item: Item) -> None:
        """Keep what is a CAN frame."""
        if isinstance(item, CanItem):
            self.add(item)

    def add(self, item: CanItem) -> None:
        """Keep a frame."""
        with self._lock:
            self._frames.append(item)
            before = self._ids.get(item.can_id)
            if before is None:
                if len(self._ids) >= MAX_IDS:
                    return
                self._ids[item.can_id] = TracedId(item, 1, None, 0)
                return
            gap_s = (item.t_mono_ns - before.latest.t_mono_ns) / 1e9
            period_s = gap_s if before.period_s is None else before.period_s + 0.1 * (gap_s - before.period_s)
            changed = sum(
                1 << i
                for i, byte in enumerate(item.data)
                if i >= len(before.latest.data) or before.latest.data[i] != byte
            )
            self._ids[item.can_id] = TracedId(item, before.count + 1, period_s, changed)

    def latest(self, limit: int | None) -> list[CanItem]:
        """The newest frames, oldest first; None gives all that are kept."""
        with self._lock:
            return list(self._frames)[-limit:] if limit is not None else list(self._frames)

    def by_id(self) -> dict[int, TracedId]:
        """One entry an id."""
        with self._lock:
            return dict(self._ids)
