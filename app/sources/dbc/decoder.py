"""Every signal of every message, of many frames at once: the form in which `learn` and tests look at a bus."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import BoolArray, FloatArray, IntArray
from app.sources.dbc.definitions import BitLayout, Definitions, MessageDefinition, SignalDefinition
from app.sources.dbc.frames import Frames

_WORD = 8  # bytes
_FLOATS = {16: (np.uint16, np.float16), 32: (np.uint32, np.float32), 64: (np.uint64, np.float64)}
_LITTLE, _BIG = "<u8", ">u8"


def raw_values(data: NDArray[np.uint8], layout: BitLayout) -> NDArray[np.uint64] | NDArray[np.int64]:
    """Return the raw numbers of a signal, before scale and offset; a float's are its bits.

    Args:
        data: (n, width) bytes of the frames.
        layout: where the number stands.

    Returns:
        (n,) unsigned, or signed where the layout is.
    """
    if layout.is_little_endian:
        first, shift = divmod(layout.start, 8)
    else:
        begin = layout.start // 8 * 8 + 7 - layout.start % 8  # counted from the first bit on the wire
        end = begin + layout.length
        first, shift = begin // 8, -end % 8
    size = (shift + layout.length + 7) // 8  # bytes that hold it, up to 9
    word = _word(data, first, min(size, _WORD), layout.is_little_endian)
    if size <= _WORD:
        value = word >> np.uint64(shift) if shift else word
    elif layout.is_little_endian:
        value = (word >> np.uint64(shift)) | (data[:, first + _WORD].astype(np.uint64) << np.uint64(64 - shift))
    else:  # the word above holds the first eight bytes, the ninth follows
        value = (word << np.uint64(8 - shift)) | (data[:, first + _WORD].astype(np.uint64) >> np.uint64(shift))
    if layout.length < 64:
        value &= np.uint64((1 << layout.length) - 1)
    if layout.is_signed and not layout.is_float:
        unused = np.int64(64 - layout.length)
        return (value.view(np.int64) << unused) >> unused
    return value


def _word(data: NDArray[np.uint8], first: int, size: int, is_little: bool) -> NDArray[np.uint64]:
    """(n,) the `size` bytes from `first` as the lowest ones of a number."""
    width, begin = data.shape[1], first + size - _WORD
    if width == _WORD and data.flags.c_contiguous:  # classic CAN: the whole frame is the word
        whole = data.view(_LITTLE if is_little else _BIG)[:, 0]
        unwanted = 8 * (first if is_little else _WORD - first - size)
        word = whole.astype(np.uint64)
        return word >> np.uint64(unwanted) if unwanted else word
    if is_little and first + _WORD <= width:
        return np.ascontiguousarray(data[:, first : first + _WORD]).view(_LITTLE)[:, 0].astype(np.uint64)
    if not is_little and begin >= 0:
        return np.ascontiguousarray(data[:, begin : begin + _WORD]).view(_BIG)[:, 0].astype(np.uint64)
    padded = np.zeros((len(data), _WORD), np.uint8)
    padded[:, (0 if is_little else _WORD - size) : (size if is_little else _WORD)] = data[:, first : first + size]
    return padded.view(_LITTLE if is_little else _BIG)[:, 0].astype(np.uint64)


def physical_values(raw: NDArray[np.uint64] | NDArray[np.int64], layout: BitLayout) -> FloatArray:
    """Return (n,) values in the signal's unit from its raw numbers."""
    if layout.is_float:
        bits, kind = _FLOATS[layout.length]
        values = raw.astype(bits).view(kind).astype(np.float64)
    else:
        values = raw.astype(np.float64)
    if layout.scale != 1.0:
        values *= layout.scale
    if layout.offset:
        values += layout.offset
    return values


@dataclass(frozen=True, slots=True)
class SignalSeries:
    """A signal's values, each with the time of its frame."""

    t_ns: NDArray[np.int64]  # (n,)
    values: FloatArray  # (n,) in the unit of the DBC


class MessageFrames:
    """The frames of one message; raw numbers are extracted once."""

    def __init__(self, message: MessageDefinition, frames: Frames) -> None:
        self.message = message
        self.frames = frames
        self._raw: dict[str, NDArray[np.int64] | NDArray[np.uint64]] = {}

    def carrying(self, signal: SignalDefinition) -> BoolArray | None:
        """(n,) which frames carry a signal; None = all: long enough, and its multiplexers say so."""
        needed = signal.layout.end_byte
        is_carried: BoolArray | None = None
        if len(self.frames) and int(self.frames.length.min()) < needed:
            is_carried = self.frames.length >= needed
        for condition in signal.conditions:
            raw = self.raw(condition.multiplexer)
            if len(condition.values) == 1:
                here = raw == raw.dtype.type(condition.values[0])
            else:
                here = np.isin(raw, np.array(condition.values).astype(raw.dtype))
            is_carried = here if is_carried is None else is_carried & here
        return is_carried

    def raw(self, name: str) -> NDArray[np.int64] | NDArray[np.uint64]:
        """(n,) raw numbers of a signal in every frame, whether it carries them or not."""
        if name not in self._raw:
            signal = self.message.signal(name)
            if signal is None or signal.layout.end_byte > self.frames.data.shape[1]:
                self._raw[name] = np.zeros(len(self.frames), np.uint64)
            else:
                self._raw[name] = raw_values(self.frames.data, signal.layout)
        return self._raw[name]


def by_message(frames: Frames, messages: Mapping[int, MessageDefinition]) -> Iterator[tuple[IntArray, MessageFrames]]:
    """Yield the frames of each message with their rows, in the order in which they came; unknown ids are left out."""
    if not len(frames) or not messages:
        return
    known_ids = np.array(sorted(messages), np.uint32)
    place = np.searchsorted(known_ids, frames.can_id)
    place[place == len(known_ids)] = 0
    code = np.where(known_ids[place] == frames.can_id, place, len(known_ids)).astype(np.uint16)
    order = np.argsort(code, kind="stable")  # 16 bits: a radix sort
    bounds = np.searchsorted(code[order], np.arange(len(known_ids) + 1))
    for i, can_id in enumerate(known_ids.tolist()):
        rows = order[bounds[i] : bounds[i + 1]]
        if len(rows):
            yield rows, MessageFrames(messages[can_id], frames.part(rows))


def decode_frames(frames: Frames, definitions: Definitions) -> dict[tuple[str, str], SignalSeries]:
    """Return the series of each signal that was received, by message and signal."""
    series: dict[tuple[str, str], SignalSeries] = {}
    for _, group in by_message(frames, definitions.by_id()):
        series.update(decode_message(group))
    return series


def decode_message(group: MessageFrames) -> dict[tuple[str, str], SignalSeries]:
    """Return the series of each signal of one message."""
    series = {}
    for signal in group.message.signals:
        if signal.layout.end_byte > group.frames.data.shape[1]:
            continue
        carrying = group.carrying(signal)
        frames = group.frames if carrying is None else group.frames.part(np.flatnonzero(carrying))
        if len(frames):
            values = physical_values(raw_values(frames.data, signal.layout), signal.layout)
            series[group.message.name, signal.name] = SignalSeries(frames.t_ns, values)
    return series
