"""Agreement of RS232 and CAN: both are windows onto one memory, so where they differ, one of them is wrong.

Only values that a CAN message carries whole are compared, each with what RS232 brought in the last seconds: a value
that moves is allowed to be as far outside as it moved meanwhile. Time is an argument.
"""

import struct
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from app.sources.master.shadow import ShadowImage
from app.telemetry import Disagreement
from firmware_protocol.can_tables import TxMessage
from firmware_protocol.memory_map import BYTE_UNUSED, Field, element_name, locate
from firmware_protocol.messages import Window

WINDOW_NS = 1_500_000_000
PERSISTENCE_NS = 2_000_000_000
FORGET_NS = 5_000_000_000  # a disagreement that CAN does not repeat says nothing any more
TOLERANCE_COUNTS = 3
TOLERANCE = 0.005


@dataclass
class _Watched:
    field: Field
    element: int
    received: deque[tuple[int, int]]  # by RS232
    differs_since_ns: int | None = None
    can_ns: int = 0
    can_raw: int = 0

    @property
    def offset(self) -> int:
        return self.field.offset + self.element * self.field.item_size

    def value(self, data: bytes | bytearray) -> int:
        return int(struct.unpack(f"<{self.field.fmt}", data)[0])


class Agreement:
    """Compares what both links bring."""

    def __init__(self) -> None:
        self._watched: dict[int, _Watched] = {}

    def watch(self, messages: Iterable[TxMessage]) -> None:
        """Compare what these messages carry from now on."""
        before, self._watched = self._watched, {}
        for message in messages:
            offsets = set(message.data_offsets[: message.length]) - {BYTE_UNUSED}
            for place in {located[:2] for offset in offsets if (located := locate(offset)) is not None}:
                watched = _Watched(*place, deque())
                is_whole = offsets >= set(range(watched.offset, watched.offset + watched.field.item_size))
                if is_whole:
                    self._watched[watched.offset] = before.get(watched.offset, watched)

    def on_rs232(self, shadow: ShadowImage, t_ns: int) -> None:
        """Take what a frame brought."""
        for offset, watched in self._watched.items():
            if shadow.measured_ns[offset] == t_ns:
                watched.received.append((t_ns, watched.value(shadow.image[offset : offset + watched.field.item_size])))
            while watched.received and watched.received[0][0] < t_ns - WINDOW_NS:
                watched.received.popleft()

    def on_can(self, windows: tuple[Window, ...], t_ns: int) -> None:
        """Compare what a message brought."""
        for window in windows:
            for offset in range(window.offset, window.offset + len(window.data)):
                watched = self._watched.get(offset)
                data = window.data[offset - window.offset :]
                if watched is not None and len(data) >= watched.field.item_size and watched.received:
                    self._compare(watched, watched.value(data[: watched.field.item_size]), t_ns)

    def _compare(self, watched: _Watched, raw: int, t_ns: int) -> None:
        values = np.array([value for t, value in watched.received if t >= t_ns - WINDOW_NS])
        if not len(values):
            return
        low, high = int(values.min()), int(values.max())
        slack = high - low + max(TOLERANCE_COUNTS, TOLERANCE * abs(raw))
        watched.can_ns, watched.can_raw = t_ns, raw
        if low - slack <= raw <= high + slack:
            watched.differs_since_ns = None
        elif watched.differs_since_ns is None:
            watched.differs_since_ns = t_ns

    def disagreements(self, t_ns: int) -> tuple[Disagreement, ...]:
        """Return what has differed for long enough, and still does."""
        return tuple(
            Disagreement(
                element_name(w.field, w.element),
                w.received[-1][1] * w.field.scale,
                w.can_raw * w.field.scale,
                w.field.unit,
                w.differs_since_ns,
            )
            for w in self._watched.values()
            if w.differs_since_ns is not None
            and w.received
            and t_ns - w.can_ns < FORGET_NS
            and w.can_ns - w.differs_since_ns >= PERSISTENCE_NS
        )
