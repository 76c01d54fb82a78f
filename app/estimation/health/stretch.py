"""A stretch of measurements of all cells, as arrays: what the judge looks back at. No file, no clock."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np

from app.estimation.arrays import FloatArray, row_mean, row_median


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Samples of all cells; NaN = not measured.

    Attributes:
        time_s: (n,) unix time [s].
        current_a, steady_a: (n,) current as sampled and averaged by the master, positive on discharge [A].
        voltage_v, temperature_degc: (n, n_cells) [V], [degC].
        soc: (n,) median estimated state of charge, 0..1.
        start_s: of the session, unix time [s].
        segments: cells of each pack.
        is_together: cells are measured together; else in turns, and voltages of one row are not of one current.
    """

    time_s: FloatArray
    current_a: FloatArray
    steady_a: FloatArray
    voltage_v: FloatArray
    temperature_degc: FloatArray
    soc: FloatArray
    start_s: float
    segments: tuple[int, ...]
    is_together: bool = True

    @property
    def pack_starts(self) -> list[int]:
        """Index of the first cell of each pack."""
        return [0, *accumulate(self.segments)][:-1]

    def pack_of(self, cell: int) -> int:
        """Return the pack of a cell; both count from 0."""
        return int(np.searchsorted(self.pack_starts, cell, side="right")) - 1

    @property
    def end_s(self) -> float:
        """Return the time of the last sample [s]."""
        return float(self.time_s[-1]) if self.time_s.size else self.start_s

    @cached_property
    def median_v(self) -> FloatArray:
        """(n,) the median cell's voltage."""
        return row_median(self.voltage_v)

    @cached_property
    def deviation_v(self) -> FloatArray:
        """(n, n_cells) each cell against the median cell."""
        return self.voltage_v - self.median_v[:, None]

    @cached_property
    def median_degc(self) -> FloatArray:
        """(n,) the median cell's temperature."""
        return row_median(self.temperature_degc)

    @cached_property
    def mean_degc(self) -> FloatArray:
        """(n,) the mean cell's temperature: finer than the whole degrees of one."""
        return row_mean(self.temperature_degc)
