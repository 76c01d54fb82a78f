"""Arrays of numbers in captured frames and lines that look like cell voltages."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.serial import ByteOrder

FEWEST = 4  # frames or lines
SURE = 0.9  # share of the frames
CELL_V = (2.0, 4.6)
NEIGHBOUR_V = 0.5
LEAST_CELLS = 3
SCALES = (1e-3, 1e-4)  # V


@dataclass(frozen=True, slots=True)
class ProposedArray:
    """A run of values that look like cell voltages."""

    at: int
    count: int
    byte_order: ByteOrder
    scale: float


def voltages_in(rows: NDArray[np.uint8]) -> ProposedArray | None:
    """Return the longest run of 16-bit numbers that cells may have; of two the one whose neighbours agree."""
    best: tuple[int, float, ProposedArray] | None = None
    for order, parity, scale in ((o, p, s) for o in ("little", "big") for p in (0, 1) for s in SCALES):
        byte_order: ByteOrder = "little" if order == "little" else "big"
        width = (rows.shape[1] - parity) // 2 * 2
        words = np.ascontiguousarray(rows[:, parity : parity + width]).view("<u2" if order == "little" else ">u2")
        volts = words.astype(np.float64) * scale
        fits = ((volts >= CELL_V[0]) & (volts <= CELL_V[1])).mean(axis=0) >= SURE
        near = (np.abs(np.diff(volts, axis=1)) <= NEIGHBOUR_V).mean(axis=0) >= SURE
        for first, last in runs(fits, near):
            if last - first + 1 < LEAST_CELLS:
                continue
            rough = float(np.abs(np.diff(volts[:, first : last + 1], axis=1)).mean())
            array = ProposedArray(parity + 2 * first, last - first + 1, byte_order, scale)
            if best is None or (array.count, -rough) > (best[0], -best[1]):
                best = array.count, rough, array
    return None if best is None else best[2]


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
