"""CAN frames in columns: what the decoder takes, live in batches and of a log, whatever tool wrote it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.sources.dbc.definitions import Definitions
from app.sources.items import CanItem
from app.sources.recordings.buses import Buses
from app.sources.recordings.can_log import OnRead, read_frames

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


AT_ONCE = 50_000  # frames that become columns: as Python's objects each takes 300 bytes, in columns 21


def load_log(path: Path, on_read: OnRead = lambda at: None, buses: Buses | None = None) -> Frames:
    """Return the frames of a log in the order of their time; time in ns since 1970, or since its begin.

    `on_read` gets the bytes read so far, repeatedly; `buses` as for `read_frames`.

    Raises:
        ImportFailed: the file cannot be read as what its name says.
    """
    read = read_frames(path, on_read=on_read, buses=buses)
    frames = ((round(t_s * 1e9), can_id, data) for t_s, can_id, data in read)
    parts = [frames_of([])]
    while part := list(islice(frames, AT_ONCE)):
        parts.append(frames_of(part))
    width = max(part.data.shape[1] for part in parts)
    t_ns = np.concatenate([part.t_ns for part in parts])
    order = np.argsort(t_ns, kind="stable")
    return Frames(
        t_ns[order],
        np.concatenate([part.can_id for part in parts])[order],
        np.concatenate([part.length for part in parts])[order],
        np.concatenate([_wide(part.data, width) for part in parts])[order],
    )


def load_log_of_bus(path: Path, definitions: Definitions, bus: str = "", on_read: OnRead = lambda at: None) -> Frames:
    """Return the frames of one bus of a log, or of all where no id of the definitions is on two.

    Raises:
        ImportFailed: as `load_log`; there is no such bus, or an id is on two.
    """
    buses = Buses(bus)
    frames = load_log(path, on_read, buses)
    buses.check(path.name, definitions.by_id())
    return frames


def _wide(data: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """The bytes of classic CAN in an array for CAN FD: zero beyond their own."""
    return np.pad(data, ((0, 0), (0, width - data.shape[1])))
