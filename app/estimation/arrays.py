"""The array types of the product, one spelling for all that compute with cells; medians, and samples at other times."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
MAD_TO_SIGMA = 1.4826  # sigma of a normal distribution over its MAD


def median(values: FloatArray) -> float:
    """Return the median of the known values; NaN where none is."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")


def latest_at(times_s: FloatArray, at_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the latest value at each time, NaN before the first.

    Args:
        times_s: (n,) in any order [s].
        at_s: (m,) when each value was measured, ascending [s].
        values: (m, ...) a number, or a row, of each.

    Returns:
        (n, ...)
    """
    place = np.searchsorted(at_s, times_s, side="right") - 1
    latest = np.full((len(times_s), *values.shape[1:]), np.nan)
    latest[place >= 0] = values[place[place >= 0]]
    return latest


def row_median(values: FloatArray) -> FloatArray:
    """Median of each row's known elements, NaN where none is known."""
    medians = np.full(len(values), np.nan)
    has_any = np.isfinite(values).any(axis=1)
    if has_any.any():
        medians[has_any] = np.nanmedian(values[has_any], axis=1)
    return medians


def row_mean(values: FloatArray) -> FloatArray:
    """Mean of each row's known elements, NaN where none is known."""
    count = np.isfinite(values).sum(axis=1)
    return np.where(count > 0, np.nansum(values, axis=1) / np.maximum(count, 1), np.nan)


def holds_all(total: float, values: FloatArray) -> bool:
    """Return whether a measured total includes the missing elements: each then has at least half of a known one."""
    finite = values[np.isfinite(values)]
    missing = values.size - finite.size
    return not missing or not finite.size or total - finite.sum() >= 0.5 * missing * finite.mean()


def robust_sigma(values: FloatArray) -> float:
    """Standard deviation of the known elements by their median deviation; outliers do not count."""
    return MAD_TO_SIGMA * median(np.abs(values - median(values)))
