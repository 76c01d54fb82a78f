"""Signals out of frames: shift and mask on 64-bit words, for all frames at once."""

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.sources.dbc.definitions import Layout

_WORD = 8  # bytes
_FLOATS = {16: (np.uint16, np.float16), 32: (np.uint32, np.float32), 64: (np.uint64, np.float64)}
_LITTLE, _BIG = "<u8", ">u8"


def raw_values(data: NDArray[np.uint8], layout: Layout) -> NDArray[np.uint64] | NDArray[np.int64]:
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


def physical_values(raw: NDArray[np.uint64] | NDArray[np.int64], layout: Layout) -> FloatArray:
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
