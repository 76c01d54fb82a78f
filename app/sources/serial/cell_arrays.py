"""Arrays of numbers in captured frames and lines that look like cell voltages."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.serial import TYPES, ByteOrder
from app.estimation.arrays import FloatArray

FEWEST = 4  # frames or lines
SURE = 0.9  # share of the frames
CELL_V = (2.0, 4.6)
NEIGHBOUR_V = 0.5
LEAST_CELLS = 3
SCALES = (1e-3, 1e-4)  # V
ORDERS: dict[ByteOrder, str] = {"little": "<", "big": ">"}
_ARRAYS = (("u16", 2, SCALES), ("u16", 3, SCALES), ("f32", 4, (1.0,)))  # type, stride, scales; 3: a number before each


@dataclass(frozen=True, slots=True)
class ProposedArray:
    """A run of values that look like cell voltages."""

    at: int
    count: int
    byte_order: ByteOrder
    scale: float
    type: str = "u16"
    stride: int = 0  # 0: they follow each other


def voltages_in(rows: NDArray[np.uint8]) -> ProposedArray | None:
    """Return the longest run of numbers that cells may have; of two the one whose neighbours agree."""
    best: tuple[int, float, ProposedArray] | None = None
    for kind, stride, scales in _ARRAYS:
        size = np.dtype(TYPES[kind]).itemsize
        for order, offset in ((order, offset) for order in ORDERS for offset in range(stride)):
            places = np.arange(offset, rows.shape[1] - size + 1, stride)
            counts = _counts(rows, places) if stride > size else None
            dtype = np.dtype(ORDERS[order] + TYPES[kind])
            numbers = np.ascontiguousarray(rows[:, places[:, None] + np.arange(size)]).view(dtype)[:, :, 0]
            for scale in scales:
                with np.errstate(invalid="ignore"):  # bytes that are no float
                    volts = numbers.astype(np.float64) * scale
                array = _longest(volts, counts)
                if array is None:
                    continue
                first, last, rough = array
                count = last - first + 1
                if best is None or (count, -rough) > best[:2]:
                    at, apart = offset + stride * first, 0 if stride == size else stride
                    best = count, -rough, ProposedArray(at, count, order, scale, kind, apart)
    return None if best is None else best[2]


def _counts(rows: NDArray[np.uint8], places: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Whether the byte before each place but the first counts on from the one before, in all rows."""
    before = rows[:, places - 1].astype(int)  # the last byte before the first place, which is not asked
    return np.asarray((np.diff(before, axis=1) == 1).all(axis=0))


def _longest(volts: FloatArray, counts: NDArray[np.bool_] | None) -> tuple[int, int, float] | None:
    """First and last column of the longest run, and how much neighbours in it differ."""
    with np.errstate(invalid="ignore"):
        fits = ((volts >= CELL_V[0]) & (volts <= CELL_V[1])).mean(axis=0) >= SURE
        near = (np.abs(np.diff(volts, axis=1)) <= NEIGHBOUR_V).mean(axis=0) >= SURE
    near = near if counts is None else near & counts
    longest: tuple[int, int, float] | None = None
    for first, last in runs(fits, near):
        if last - first + 1 < LEAST_CELLS:
            continue
        rough = float(np.abs(np.diff(volts[:, first : last + 1], axis=1)).mean())
        if longest is None or (last - first, -rough) > (longest[1] - longest[0], -longest[2]):
            longest = first, last, rough
    return longest


def runs(fits: NDArray[np.bool_], near: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield first and last of each run of numbers that fit and are near each other."""
    first: int | None = None
    for k, is_cell in enumerate(fits.tolist()):
        if first is not None and (not is_cell or not near[k - 1]):
            yield first, k - 1
            first = None
        if is_cell and first is None:
            first = k
    if first is not None:
        yield first, len(fits) - 1
