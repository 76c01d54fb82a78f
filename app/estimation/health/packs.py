"""Packs of a battery, which may differ in size, as one table: cells of a pack share air and board."""

from __future__ import annotations

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.errors import ShapeError


class Packs:
    """A row for each pack, as long as the longest; NaN where a pack has fewer cells."""

    def __init__(self, sizes: tuple[int, ...]) -> None:
        """Take the number of cells of each pack.

        Raises:
            ShapeError: there is no pack, or one without a cell.
        """
        if not sizes or min(sizes) < 1:
            raise ShapeError("packs", (1,), sizes)
        self.n_cells = sum(sizes)
        self.count = np.array(sizes)
        self._is_cell = np.arange(max(sizes)) < self.count[:, None]

    def table(self, values: FloatArray) -> FloatArray:
        """Return (n_packs, longest) of (n_cells,)."""
        table = np.full(self._is_cell.shape, np.nan)
        table[self._is_cell] = values
        return table

    def flat(self, table: FloatArray) -> FloatArray:
        """Return (n_cells,) of (n_packs, longest)."""
        return np.asarray(table[self._is_cell])

    def each_cell(self, of_packs: FloatArray) -> FloatArray:
        """Return (n_cells,): what (n_packs,) says of its pack."""
        return np.repeat(of_packs, self.count)

    def median(self, values: FloatArray) -> FloatArray:
        """Return (n_cells,) the median of what is known in each cell's pack; NaN where nothing is."""
        return self.each_cell(medians(self.table(values), axis=1)[:, 0])

    def has_more_than(self, share: float, is_known: BoolArray) -> BoolArray:
        """Return (n_cells,) whether more than this share of each cell's pack is true in (n_cells,)."""
        starts = np.cumsum(self.count) - self.count
        return np.repeat(np.add.reduceat(is_known.astype(np.intp), starts) > share * self.count, self.count)

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """Return the other cells of a cell's pack."""
        pack = np.repeat(np.arange(len(self.count)), self.count)
        return tuple(int(other) for other in np.flatnonzero(pack == pack[cell]) if other != cell)


def medians(table: FloatArray, axis: int) -> FloatArray:
    """Return the medians of what is known along an axis, which stays with length 1; NaN where nothing is."""
    is_finite = np.isfinite(table)
    ordered = np.sort(np.where(is_finite, table, np.inf), axis=axis)
    count = is_finite.sum(axis=axis, keepdims=True)
    low = np.take_along_axis(ordered, np.maximum((count - 1) // 2, 0), axis)
    high = np.take_along_axis(ordered, np.minimum(count // 2, table.shape[axis] - 1), axis)
    is_known = count > 0
    return np.where(is_known, 0.5 * (np.where(is_known, low, 0.0) + np.where(is_known, high, 0.0)), np.nan)
