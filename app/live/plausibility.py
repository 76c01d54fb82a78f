"""Numbers that ought to agree: the sum of the cells with the total, current with voltage, the chips with the master.

Each check has a verdict: True where both sides agree, False where they contradict each other, None where one side is
missing or says nothing. A check never changes a value; it says how far one may be trusted.
"""

import math
from collections import deque

import numpy as np

from app.battery.battery import Battery
from app.estimation.health.packs import Packs
from app.telemetry import Cells, Check, FloatArray, Plausibility

AT_ONCE_S = 0.5  # between the oldest and the newest voltage of a sum: later, the current is another
SUM_LIMIT_V = 0.5  # rounding of 96 cells and of the total
CHIP_LIMIT_V = 0.025  # deviation of a cell from its pack, chip against master
CHIPS_EVERY_S = 1.0  # the slow windows come no sooner
CHIP_AGE_S = 5  # the chips' readings are older than the master's by up to this
CHIP_READINGS = 10  # one after the other have to contradict
STEP_S = 0.5  # between the two samples of a difference: longer than the master's voltage filter takes
MEMORY_S = 60.0
LEAST_CURRENT_A = 30.0  # root of the summed squares of the steps, before their ratio says anything
LEAST_VOLTAGE_V = 0.08  # mean voltage change of a cell, likewise
RESISTANCE_OHM = (2e-3, 0.2)  # resistance of one 18650 with its joints, new to worn out; cells in parallel share it


class PlausibilityChecks:
    """Follows the measurements; `verdicts` judges the newest."""

    def __init__(self, battery: Battery) -> None:
        self._resistance_ohm = tuple(ohm / battery.parallel for ohm in RESISTANCE_OHM)
        self._recent: deque[tuple[float, float, float]] = deque()  # (time, current, mean cell voltage)
        self._time_s = 0.0
        self._squares_a2 = 0.0
        self._products_va = 0.0
        self._squares_v2 = 0.0
        self._chips = _ChipComparison(Packs(battery.segments))

    def step(self, dt_s: float | None, current_a: float, cells_v: FloatArray, chips_v: FloatArray) -> None:
        """Take a measurement.

        Args:
            dt_s: since the last one [s]; None begins anew.
            current_a: positive on discharge [A].
            cells_v: (n_cells,) cell voltages, NaN where missing [V].
            chips_v: (n_cells,) as the slaves' chips read them, NaN where missing [V].
        """
        if dt_s is None or dt_s > STEP_S:
            self._recent.clear()
        dt_s = dt_s or 0.0
        self._time_s += dt_s
        mean_v = float(np.nanmean(cells_v))
        self._recent.append((self._time_s, current_a, mean_v))
        fade = math.exp(-dt_s / MEMORY_S)
        self._squares_a2 *= fade
        self._products_va *= fade
        self._squares_v2 *= fade
        if self._time_s - self._recent[0][0] >= STEP_S:
            _, before_a, before_v = self._recent.popleft()
            step_a, step_v = current_a - before_a, mean_v - before_v
            self._squares_a2 += step_a**2
            self._products_va -= step_a * step_v
            self._squares_v2 += step_v**2
        self._chips.step(dt_s, cells_v, chips_v)

    def verdicts(self, cells: Cells, total_v: float | None, total_error: float = 0.0) -> Plausibility:
        """Return what each check finds; `total_v` is the sum that was measured, off by this share of it at most."""
        return Plausibility(_sum(cells, total_v, total_error), self._current(), self._chips.check())

    def _current(self) -> Check:
        low, high = self._resistance_ohm
        if self._squares_a2 < LEAST_CURRENT_A**2:
            still = math.sqrt(self._squares_v2) >= LEAST_VOLTAGE_V  # voltages move, current does not
            return Check(False if still else None, None, high, "ohm", None)
        resistance_ohm = self._products_va / self._squares_a2
        return Check(low <= resistance_ohm <= high, resistance_ohm, high, "ohm", None)


class _ChipComparison:
    """Each cell's deviation from its pack, by the slave's chip and by the master.

    A chip's reading was taken at another instant, maybe at another current, and at a grown joint the deviation follows
    the current. So a cell is allowed to be as far outside what the master reported of late as it moved meanwhile, and
    only what is outside at every look is a contradiction.
    """

    def __init__(self, segments: Packs) -> None:
        self._segments = segments
        self._since_s = 0.0
        self._low_v = self._high_v = np.full(segments.n_cells, np.nan)  # extremes of the current second
        self._ranges: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=CHIP_AGE_S)  # extremes of the seconds before
        self._outside_v: deque[FloatArray] = deque(maxlen=CHIP_READINGS)

    def step(self, dt_s: float, cells_v: FloatArray, chips_v: FloatArray) -> None:
        deviation_v = self._deviation(cells_v)
        self._low_v, self._high_v = np.fmin(self._low_v, deviation_v), np.fmax(self._high_v, deviation_v)
        self._since_s += dt_s
        if self._outside_v and self._since_s < CHIPS_EVERY_S:
            return
        self._since_s = 0.0
        self._ranges.append((self._low_v, self._high_v))
        self._low_v = self._high_v = deviation_v
        low_v = np.fmin.reduce([low for low, _ in self._ranges])
        high_v = np.fmax.reduce([high for _, high in self._ranges])
        chip_v = self._deviation(chips_v)
        beyond_v = np.maximum(low_v - chip_v, chip_v - high_v) - (high_v - low_v)
        self._outside_v.append(np.maximum(beyond_v, 0.0))

    def check(self) -> Check:
        least_v = np.fmin.reduce(self._outside_v) if self._outside_v else self._low_v * np.nan
        if np.isnan(least_v).all():
            return Check(None, None, CHIP_LIMIT_V, "V", None)
        cell = int(np.nanargmax(least_v))
        value_v = float(least_v[cell])
        agree = value_v <= CHIP_LIMIT_V
        verdict = agree or (False if len(self._outside_v) == CHIP_READINGS else None)
        return Check(verdict, value_v, CHIP_LIMIT_V, "V", cell)

    def _deviation(self, values_v: FloatArray) -> FloatArray:
        """(n_cells,) each cell against the median of its pack, NaN where it or all of the pack is missing."""
        return values_v - self._segments.median(values_v)


def _sum(cells: Cells, total_v: float | None, total_error: float) -> Check:
    ages_s = cells.voltage_age_s
    is_at_once = ages_s is None or float(ages_s.max(initial=0.0) - ages_s.min(initial=np.inf)) <= AT_ONCE_S
    if total_v is None or np.isnan(cells.voltage_v).any() or not is_at_once:
        return Check(None, None, SUM_LIMIT_V, "V", None)
    difference, limit_v = abs(float(cells.voltage_v.sum()) - total_v), max(SUM_LIMIT_V, total_error * total_v)
    return Check(difference <= limit_v, difference, limit_v, "V", None)
