"""Values that come one by one, each with its own time, as rows of one time axis: the newest that is not too old.

What `app.sources.dbc.assembly` does value by value while they come, here over arrays of a minute.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.sources.dbc.assembly import LEAST_AGE_S, PERIODS_BRIDGED, UNKNOWN_AGE_S

_NEVER_US = -np.inf
Samples = tuple[NDArray[np.intp], NDArray[np.int64], FloatArray]  # (k,) elements, (n,) times [us], (n, k) values


class Holder:
    """Remembers the newest value of each element from one call to the next."""

    def __init__(self, n_elements: int, max_age_s: float | None = None) -> None:
        """`max_age_s`: from then on a value is missing; None: three of its own periods as heard."""
        self._value = np.full(n_elements, np.nan)
        self._t_us = np.full(n_elements, _NEVER_US)
        self._period_us = np.full(n_elements, np.nan)
        self._max_age_s = max_age_s

    def rows(self, samples: Iterable[Samples], grid_us: NDArray[np.int64]) -> FloatArray:
        """Return (n, elements) the newest values at ascending times; samples are not older than those of before."""
        return self.rows_and_times(samples, grid_us)[0]

    def rows_and_times(self, samples: Iterable[Samples], grid_us: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """As `rows`, with the (n, elements) times of the values [us]."""
        shape = (len(grid_us), len(self._value))
        found, at_us = np.broadcast_to(self._value, shape).copy(), np.broadcast_to(self._t_us, shape).copy()
        for elements, times_us, values in samples:
            self._learn(elements, times_us)
            newest = np.searchsorted(times_us, grid_us, side="right") - 1
            is_there = np.flatnonzero(newest >= 0)
            newest = newest[is_there]
            place = np.ix_(is_there, elements)
            is_newer = times_us[newest][:, None] >= at_us[place]
            found[place] = np.where(is_newer, values[newest], found[place])
            at_us[place] = np.where(is_newer, times_us[newest][:, None], at_us[place])
            last = times_us[-1] >= self._t_us[elements]
            self._value[elements] = np.where(last, values[-1], self._value[elements])
            self._t_us[elements] = np.where(last, times_us[-1], self._t_us[elements])
        age_us = grid_us[:, None] - at_us
        found[age_us > self._most_us()] = np.nan
        return found, at_us

    def _learn(self, elements: NDArray[np.intp], times_us: NDArray[np.int64]) -> None:
        """The longest gap between two samples that is no pause."""
        before_us = self._t_us[elements[0]]
        gaps_us = np.diff(times_us, prepend=before_us) if before_us != _NEVER_US else np.diff(times_us)
        gaps_us = gaps_us[gaps_us > 0]
        if len(gaps_us):
            self._period_us[elements] = min(float(gaps_us.max()), PERIODS_BRIDGED * float(np.median(gaps_us)))

    def _most_us(self) -> FloatArray | float:
        if self._max_age_s is not None:
            return 1e6 * self._max_age_s
        most_us = np.maximum(1e6 * LEAST_AGE_S, PERIODS_BRIDGED * self._period_us)
        return np.where(np.isnan(most_us), 1e6 * UNKNOWN_AGE_S, most_us)


def grid_of(first_us: int, last_us: int, period_us: int) -> NDArray[np.int64]:
    """Return the multiples of a period within a range, ends included."""
    return np.arange(-(-first_us // period_us), last_us // period_us + 1, dtype=np.int64) * period_us
