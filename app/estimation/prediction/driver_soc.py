"""The driver's SOC: one whole number of percent that does not flicker and never flatters.

Per cell the SOC in permille is averaged over the last 100 samples and floored to whole percent; the driver sees
the lowest cell. The spread is the highest cell minus the lowest. Source: SPKF-2020.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.errors import ShapeError

WINDOW: Final = 100  # samples in the average


@dataclass(frozen=True)
class DriverReading:
    """The driver's number and where it comes from.

    Attributes:
        percent: SOC of the lowest cell, floored to whole percent; None while no cell has been estimated.
        cell: index of that cell, counted from 0; None likewise.
        spread_percent: highest minus lowest averaged SOC, in percent; 0 while nothing is known.
    """

    percent: int | None
    cell: int | None
    spread_percent: float


class DriverSoc:
    """Moving average over the last 100 samples of n_cells cells."""

    def __init__(self, n_cells: int) -> None:
        self._window_permille = np.full((WINDOW, n_cells), np.nan)
        self._sum_permille = np.zeros(n_cells)
        self._count = np.zeros(n_cells, dtype=np.int64)
        self._next = 0

    def step(self, soc: ArrayLike) -> DriverReading:
        """Return the reading after one more sample of SOC (n_cells,), 0..1; NaN = cell not estimated, left out.

        Raises:
            ShapeError: `soc` is not (n_cells,).
        """
        values = np.asarray(soc, dtype=np.float64)
        if values.shape != self._sum_permille.shape:
            raise ShapeError("soc", self._sum_permille.shape, values.shape)
        new = np.rint(1000.0 * values)
        old = self._window_permille[self._next]
        entering, leaving = ~np.isnan(new), ~np.isnan(old)
        self._sum_permille += np.where(entering, new, 0.0) - np.where(leaving, old, 0.0)
        self._count += entering.astype(np.int64) - leaving
        self._window_permille[self._next] = new
        self._next = (self._next + 1) % WINDOW
        seen = self._count > 0
        if not seen.any():
            return DriverReading(None, None, 0.0)
        mean = np.where(seen, self._sum_permille / np.maximum(self._count, 1), np.nan)
        cell = int(np.nanargmin(mean))
        return DriverReading(int(mean[cell] // 10.0), cell, float(np.nanmax(mean) - mean[cell]) / 10.0)
