"""Numbers of a table that are no measurement: integers that overflowed, sensors that are absent, signs that are flags.

Every reader of tables takes them out here, counted; they are missing, never 0.
"""

import numpy as np

from app.estimation.arrays import FloatArray, median, row_median
from app.words import Message

FULL_SCALE = (2.0**31, 2.0**31 - 1.0, 2.0**32 - 1.0, 2.0**15, 2.0**15 - 1.0, 2.0**16 - 1.0)
SCALES = (1.0, 0.1, 0.01, 0.001)  # factors of an integer on its way into a table
WRAP_SCALES = (1.0, 0.1, 0.01)  # at 0.001 a pulse of 60 A would be one
WRAPS = 2.0**16  # a small negative number that was read without its sign is so much too large
FAR = 5.0  # times the largest other current
MOST_SHARE = 0.2  # share of the rows: more are no faults
LEAST_A = 30.0  # a smaller current is none of them
ABSENT_DEGC = -40.0  # the lowest count of many sensors, and what is read where there is none
WARMER_DEGC = 15.0  # than that are the sensors that are there
CELL_V = (0.5, 6.0)
SAME_CELL_V = 0.5  # a magnitude so near to the others' is a cell's voltage


def measured_currents(current_a: FloatArray, notes: list[Message]) -> FloatArray:
    """Return (n,) currents with NaN for integers that overflowed: full scale, or 16 bits without their sign."""
    size_a = np.abs(current_a)
    is_odd = np.zeros(len(size_a), np.bool_)
    for scale in SCALES:
        for full in FULL_SCALE:
            is_odd |= np.isclose(size_a, full * scale, rtol=1e-9, atol=1e-6 * scale)
    is_odd &= size_a > max(FAR * _largest(size_a[~is_odd]), LEAST_A)
    is_unsigned = not np.any(current_a[~is_odd] < 0.0)  # else a large current is a pulse
    for scale in WRAP_SCALES if is_unsigned else ():  # -5.0 A of 0.01 A each as 655.36 - 5
        wrapped_a = current_a - WRAPS * scale
        rest_a = _largest(size_a[~is_odd & ~(np.abs(wrapped_a) < WRAPS * scale / FAR / 2.0)])
        is_odd |= (wrapped_a < 0.0) & (-wrapped_a <= 2.0 * rest_a) & (size_a > max(FAR * rest_a, LEAST_A))
    if np.mean(is_odd) > MOST_SHARE or not is_odd.any():
        return current_a
    notes.append(Message("current-impossible", n=int(is_odd.sum())))
    return np.where(is_odd, np.nan, current_a)


def measured_temperatures(temperatures_degc: FloatArray, notes: list[Message]) -> FloatArray:
    """Return (n, sensors) temperatures with NaN where a sensor is absent: -40 degC while others are far warmer."""
    is_absent = np.abs(temperatures_degc - ABSENT_DEGC) < 0.05
    others = np.where(is_absent, np.nan, temperatures_degc)
    if not is_absent.any() or not median(others) > ABSENT_DEGC + WARMER_DEGC:
        return temperatures_degc
    notes.append(Message("temperature-absent", n=int(is_absent.sum())))
    return np.where(is_absent, np.nan, temperatures_degc)


def cell_voltages(voltages_v: FloatArray, notes: list[Message]) -> FloatArray:
    """Return (n, cells) voltages as magnitudes where a sign only marks a cell, such as one whose shunt is on."""
    low_v, high_v = CELL_V
    sizes_v = np.abs(voltages_v)
    is_marked = (voltages_v < 0.0) & (sizes_v > low_v) & (sizes_v < high_v)
    if voltages_v.shape[1] == 1 or not is_marked.any():
        return voltages_v
    is_cell = (sizes_v > low_v) & (sizes_v < high_v)
    usual_v = row_median(np.where(is_cell, sizes_v, np.nan))[:, None]
    is_marked &= np.abs(sizes_v - usual_v) < SAME_CELL_V
    notes.append(Message("voltages-marked", n=int(is_marked.sum())))
    return np.where(is_marked, sizes_v, voltages_v)


def _largest(values: FloatArray) -> float:
    """Return the largest of the known values, 0 where there is none."""
    return float(np.max(values[np.isfinite(values)], initial=0.0))
