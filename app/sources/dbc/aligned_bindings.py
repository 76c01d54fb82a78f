"""Many messages of a few frames each, as they come live: all their signals in one pass of numpy.

For messages whose every lane is plain: one number at one place of each frame, without multiplexer, cell number, flag or
checksum. The values are those that `BatteryDecoder` reads lane by lane, which is faster for many frames of a message.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray, IntArray
from app.sources.dbc.bindings import SignalBinding, SignalBindings
from app.sources.dbc.definitions import MessageDefinition
from app.sources.dbc.frames import Frames

_PAD = 8  # bytes before and after a frame, so that a word fits around each of its bytes
_LONGEST = 56  # bits: with any shift within one word of 64
_NO_CODE = np.iinfo(np.int64).min


class AlignedBindings:
    """The plain messages of a battery."""

    def __init__(self, lanes: SignalBindings) -> None:
        """Collect them out of all lanes."""
        self.ids = tuple(
            can_id
            for can_id, bindings in sorted(lanes.by_id.items())
            if all(_is_plain(lane, lanes.messages[can_id]) for lane in bindings)
        )
        ordered = [lane for can_id in self.ids for lane in lanes.by_id[can_id]]
        layouts = [lane.layout for lane in ordered]
        self._can_id = np.array(self.ids, np.uint32)
        self._count = np.array([len(lanes.by_id[can_id]) for can_id in self.ids], np.intp)
        self._first = np.cumsum(self._count) - self._count  # lane of each message
        self.kinds = tuple(dict.fromkeys(lane.kind for lane in ordered))
        self._kind = np.array([self.kinds.index(lane.kind) for lane in ordered], np.intp)
        self._index = np.array([lane.index for lane in ordered], np.intp)
        self._is_little = np.array([layout.is_little_endian for layout in layouts], np.bool_)
        places = [_place(lane) for lane in ordered]
        self._at = np.array([at for at, _ in places], np.intp)  # offset of the word in a padded frame
        self._shift = np.array([shift for _, shift in places], np.uint64)
        self._mask = np.array([(1 << layout.length) - 1 for layout in layouts], np.uint64)
        self._sign = np.array([1 << (layout.length - 1) if layout.is_signed else 0 for layout in layouts], np.int64)
        self._scale = np.array([layout.scale for layout in layouts])
        self._offset = np.array([layout.offset for layout in layouts])
        self._end = np.array([layout.end_byte for layout in layouts], np.intp)
        codes = [() if lane.entry is None else lane.entry.invalid for lane in ordered]
        self._invalid = np.full((len(ordered), max(map(len, codes), default=0)), _NO_CODE, np.int64)
        for row, code in zip(self._invalid, codes, strict=True):
            row[: len(code)] = code
        ranges = [None if lane.entry is None else lane.entry.valid_range for lane in ordered]
        self._low = np.array([-np.inf if bounds is None else bounds[0] for bounds in ranges])
        self._high = np.array([np.inf if bounds is None else bounds[1] for bounds in ranges])

    def decode(self, frames: Frames) -> Iterator[tuple[str, tuple[IntArray, IntArray, FloatArray]]]:
        """Yield kind, and rows of the frames, channels and values, in the order of the frames."""
        if not len(frames) or not self.ids:
            return
        message = np.searchsorted(self._can_id, frames.can_id)
        message[message == len(self._can_id)] = 0
        here = np.flatnonzero(self._can_id[message] == frames.can_id)
        counts = self._count[message[here]]
        row = np.repeat(here, counts)
        begin = np.repeat(self._first[message[here]] - (np.cumsum(counts) - counts), counts)
        lane = begin + np.arange(len(row))
        is_there = frames.length[row] >= self._end[lane]
        if not is_there.all():
            row, lane = row[is_there], lane[is_there]
        raw = self._raw(frames.data, row, lane)
        value = raw.astype(np.float64) * self._scale[lane] + self._offset[lane]
        value[(value < self._low[lane]) | (value > self._high[lane])] = np.nan
        if self._invalid.shape[1]:
            value[(self._invalid[lane] == raw[:, None]).any(axis=1)] = np.nan
        kind, index = self._kind[lane], self._index[lane]
        for number, name in enumerate(self.kinds):
            of_kind = np.flatnonzero(kind == number)
            if len(of_kind):
                yield name, (row[of_kind], index[of_kind], value[of_kind])

    def _raw(self, data: NDArray[np.uint8], row: IntArray, lane: IntArray) -> NDArray[np.int64]:
        padded = np.zeros((len(data), data.shape[1] + 2 * _PAD), np.uint8)
        padded[:, _PAD:-_PAD] = data
        at = row * padded.shape[1] + self._at[lane]
        words = padded.ravel()[at[:, None] + np.arange(8)]
        word = np.where(self._is_little[lane], words.view("<u8")[:, 0], words.view(">u8")[:, 0])
        raw = ((word >> self._shift[lane]) & self._mask[lane]).astype(np.int64)
        sign = self._sign[lane]
        signed: NDArray[np.int64] = (raw ^ sign) - sign
        return signed


def _is_plain(lane: SignalBinding, message: MessageDefinition) -> bool:
    layout, entry, signal = lane.layout, lane.entry, message.signal(lane.signal)
    return (
        lane.table is None
        and not lane.numbers
        and lane.flag is None
        and not lane.kind.startswith("state.")
        and not layout.is_float
        and layout.length <= _LONGEST
        and (entry is None or not entry.checksum)
        and signal is not None
        and not signal.conditions
    )


def _place(lane: SignalBinding) -> tuple[int, int]:
    """Where the word of 8 bytes around a number begins in a padded frame, and by how much it is shifted."""
    layout = lane.layout
    if layout.is_little_endian:
        first, shift = divmod(layout.start, 8)
        return _PAD + first, shift
    end = layout.start // 8 * 8 + 7 - layout.start % 8 + layout.length  # counted from the first bit on the wire
    return _PAD + (end + 7) // 8 - 8, -end % 8
