"""CAN frames in columns: what the decoder takes, live in batches and offline by the million."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.sources.items import CanItem

TimedFrame = tuple[int, int, bytes]  # time [ns], id with bit 31 for 29-bit ones, data
_WIDTHS = (8, 64)  # bytes of classic CAN and of CAN FD


@dataclass(frozen=True, slots=True)
class Frames:
    """n frames in the order in which they came; `data` is zero beyond each frame's length."""

    t_ns: NDArray[np.int64]  # (n,)
    can_id: NDArray[np.uint32]  # (n,) bit 31 marks a 29-bit one
    length: NDArray[np.uint8]  # (n,) bytes
    data: NDArray[np.uint8]  # (n, 8) or (n, 64)

    def __len__(self) -> int:
        return len(self.t_ns)

    def part(self, rows: NDArray[np.intp] | slice) -> "Frames":
        """Some of the frames."""
        return Frames(self.t_ns[rows], self.can_id[rows], self.length[rows], self.data[rows])


def frames_of(items: Iterable[TimedFrame]) -> Frames:
    """Return frames as columns."""
    rows: Sequence[TimedFrame] = items if isinstance(items, list) else list(items)
    if not rows:
        return Frames(np.empty(0, np.int64), np.empty(0, np.uint32), np.empty(0, np.uint8), np.empty((0, 8), np.uint8))
    times, ids, datas = zip(*rows, strict=True)
    lengths = np.fromiter(map(len, datas), np.uint8, len(datas))
    width = _WIDTHS[0] if lengths.max() <= _WIDTHS[0] else _WIDTHS[1]
    joined = b"".join(data.ljust(width, b"\0") for data in datas)
    data = np.frombuffer(joined, np.uint8).reshape(-1, width)
    return Frames(np.array(times, np.int64), np.array(ids, np.uint32), lengths, data)


def frames_of_items(items: Iterable[CanItem]) -> Frames:
    """Return what a CAN link delivered as columns; time is that of the monotonic clock."""
    return frames_of([(item.t_mono_ns, item.can_id, item.data) for item in items])
