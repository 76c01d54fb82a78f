"""The sign of a current: how it steps with the voltage, and whether its definition left the sign out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.sources.dbc.battery_decoder import ChannelValues
from app.sources.dbc.definitions import BitLayout

CLEAR = 0.4  # least correlation of current and voltage steps that decides the sign
_COARSER = (1, 4, 16, 64)  # samples a step: a current at 100 Hz moves little from one to the next
_BY_CHANCE = 3.0  # standard deviations of a correlation of what has nothing to do with each other


@dataclass(frozen=True, slots=True)
class VoltageSeries:
    """The sum of all cells over time, from cells or from the pack voltage."""

    t_ns: NDArray[np.int64]
    values: FloatArray  # V


def cell_means(voltages: ChannelValues, n_cells: int) -> FloatArray:
    """(n_cells,) mean voltage of each cell, NaN where it was not received."""
    is_measured = np.isfinite(voltages.value)
    index, value = voltages.index[is_measured], voltages.value[is_measured]
    count = np.bincount(index, minlength=n_cells)
    total = np.bincount(index, weights=value, minlength=n_cells)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def cells_together(voltages: ChannelValues, n_cells: int) -> VoltageSeries:
    """Return by how much cells differ from their own means over time."""
    is_measured = np.isfinite(voltages.value)
    means = cell_means(voltages, n_cells)
    return VoltageSeries(voltages.t_ns[is_measured], voltages.value[is_measured] - means[voltages.index[is_measured]])


def step_correlation(t_ns: NDArray[np.int64], current_a: FloatArray, voltage: VoltageSeries) -> float:
    """Return the correlation of the steps of a current with those of the voltage; 0 where it may be by chance.

    -1 where positive is discharge.
    """
    if len(voltage.t_ns) < 8 or len(t_ns) < 8:
        return 0.0
    start, end = max(t_ns[0], voltage.t_ns[0]), min(t_ns[-1], voltage.t_ns[-1])
    n = int(min(len(t_ns), len(voltage.t_ns), 5000))
    if end <= start:
        return 0.0
    strongest = 0.0
    for bins in (n // times for times in _COARSER if n // times >= 8):
        edges = np.linspace(start, end, bins + 1)
        current, volts = _binned(t_ns, current_a, edges), _binned(voltage.t_ns, voltage.values, edges)
        both = np.isfinite(current) & np.isfinite(volts)
        steps_a, steps_v = np.diff(current[both]), np.diff(volts[both])
        moved = np.abs(steps_a) > 0.05 * (np.ptp(current[both]) if both.any() else 1.0)
        if np.count_nonzero(moved) < 4 or np.std(steps_v) == 0 or np.std(steps_a) == 0:
            continue
        together = float(np.corrcoef(steps_a, steps_v)[0, 1])
        if abs(together) > max(abs(strongest), _BY_CHANCE / np.sqrt(len(steps_a))):
            strongest = together
    return strongest


def _binned(t_ns: NDArray[np.int64], values: FloatArray, edges: FloatArray) -> FloatArray:
    """(n,) mean in each bin, NaN where nothing was received."""
    at = np.clip(np.searchsorted(edges, t_ns, side="right") - 1, 0, len(edges) - 2)
    inside = (t_ns >= edges[0]) & (t_ns <= edges[-1]) & np.isfinite(values)
    count = np.bincount(at[inside], minlength=len(edges) - 1)
    total = np.bincount(at[inside], weights=values[inside], minlength=len(edges) - 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def wraps(raw: NDArray[np.int64] | NDArray[np.uint64], layout: BitLayout) -> bool:
    """Return whether raw numbers of an unsigned definition are those of a signed one: some near its top, none between.

    The top itself may stand for a value that was not measured.
    """
    if layout.is_signed or layout.is_float or layout.offset or not 8 <= layout.length < 63:
        return False
    numbers = np.unique(raw.astype(np.int64))
    quarter = 1 << (layout.length - 2)
    at_top = numbers[(numbers >= 3 * quarter) & (numbers < 4 * quarter - 1)]
    return len(at_top) > 0 and not ((numbers >= quarter) & (numbers < 3 * quarter)).any()


def signed(values: FloatArray, layout: BitLayout) -> FloatArray:
    """Return values of an unsigned definition as a signed one reads them."""
    span = layout.scale * (1 << layout.length)
    return np.where(np.abs(values) >= abs(span) / 2, values - span, values)
