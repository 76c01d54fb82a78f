"""Leaks and lost capacity: drift of every cell's charge against its pack, at rest and driving.

A Kalman filter for each cell, fed with one reading of the cell's open-circuit voltage every READING_S:

    x' = -(i_leak + g i) / C      charge against the pack's median cell; i_leak: what leaks, g = C / C_cell - 1
    p' = -p / tau                 slow overpotentials, of two time constants, more where a larger current flows
    z  = x + (p1 + p2 - R i_leak) / (dOCV/dSOC)      what the voltage without its fast drops shows

Leak and lost capacity part because one goes on while the car stands. Two such filters run: one for leaks that begin
suddenly, one that remembers over sessions what is as small as self-discharge.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.errors import ShapeError, check_step
from app.estimation.health.packs import Packs

READING_S: Final = 30.0
SAMPLES_MIN: Final = 10  # in a reading
REST_A: Final = 1.0
SETTLED_S: Final = 30.0  # time of standing before a reading at rest: then fast pairs are gone
COASTING_S: Final = 3.0  # without current: longer is standing
PAIR_S: Final = 10.0
EXCITED_A: Final = 10.0  # std of the current in a reading while driving: less parts no drop from the OCV
GAP_S: Final = 10.0  # what flowed in a longer gap is not known
SLOW_S: Final = np.array((150.0, 1800.0))  # time constants of slow overpotentials
MEAN_S: Final = 600.0  # time of the mean current
QUICK, LASTING = 0, 1  # the two filters
LEAK_WALK_A2: Final = np.array((1.0 / 60.0, (2e-3) ** 2 / 86400.0))[
    :, None
]  # random walk of i_leak in a second [A^2/s]
LEAK_PRIOR_A: Final = np.array((0.5, 0.5))[:, None]
CAPACITY_PRIOR: Final = 0.3
START_SIGMA: Final = 0.3  # sigma of the charge against the pack's
REST_V: Final = 1.5e-4  # noise of a reading at rest
NOISE_SHARE: Final = 0.05  # share of the variance within a reading that the mean over it keeps
DRIVE_V: Final = 1.5e-3  # and of one while driving
SLOW_FLOOR_V: Final = 4e-4  # temperature, hysteresis
SLOW_START_V: Final = 1e-3  # at a start: what was before is not known
SLOW_OHM: Final = 1.5e-4  # by which the slow overpotentials of like cells differ, over the mean current
SLOW_FRAC_OHM: Final = 1.5e-3  # and of a cell that resists more, for so much of its resistance
LIKE: Final = 0.15  # a resistance that is no more than this above the others' is like them
OCV_SHAPE: Final = 0.03  # share of a distance between charges: the cell file's OCV is not quite the cell's
COUNT_FRAC: Final = 2e-3  # share of the charge that flowed
SOC_MIN, SOC_MAX = 0.15, 1.0  # where the cell file's OCV can be trusted to a few millivolts
BLEED_A: Final = 0.3  # more does not flow through a balancing resistor
MOVED_FRAC: Final = 0.01  # share of charge in a gap: then the car was driven or charged
LOST_SIGMA: Final = 0.02  # sigma of the charge against the pack's after that
CAPACITY_SHAPE: Final = 0.2  # share of lost capacity that a wrong OCV may show as a leak
SURPRISE_SIGMAS: Final = 4.0
SUDDEN_SIGMAS: Final = 4.0  # apart: the lasting filter does not see a leak that the quick one does
QUICK_SIGMAS: Final = 3.0  # above nothing: then the quick filter counts
CAPACITY_SIGMA: Final = 0.015  # what the readings' model leaves out of lost capacity
LEAK_SIGMA_FRAC: Final = 0.15  # and of a leak: slope of the OCV, slow drop of the leak itself
X, LEAK, CAPACITY, SLOW, SLOWER = range(5)
STATES: Final = 5


@dataclass(frozen=True)
class ChargeMemory:
    """The lasting filter, for the next session: when it last looked, over how long, and what it found.

    Attributes:
        time_s: of the last reading [s].
        evidence_s: from the first reading to the last [s].
        soc: median cell then.
        mean: (STATES, n_cells).
        cov: (STATES, STATES, n_cells).
    """

    time_s: float
    evidence_s: float
    soc: float
    mean: FloatArray
    cov: FloatArray


@dataclass(frozen=True)
class ChargeDrift:
    """Leak and lost capacity by the readings so far, (n_cells,).

    Attributes:
        leak_a: what leaks [A], by the quick filter where that is surer of it.
        leak_sigma_a: its standard deviation, scatter of the other cells included [A].
        leak_noise_a: the part of it that is there without a leak: what a leak has to exceed [A].
        lost: part of the capacity that is gone against the pack's median cell, by the filter that is less sure of it.
        lost_sigma: its standard deviation.
    """

    leak_a: FloatArray
    leak_sigma_a: FloatArray
    leak_noise_a: FloatArray
    lost: FloatArray
    lost_sigma: FloatArray


class ChargeWatch:
    """Call `step` with every sample; `drift` after it returned True."""

    def __init__(self, cell: CellModel, packs: Packs, memory: ChargeMemory | None = None) -> None:
        """Start, or go on with what an earlier session left.

        Raises:
            ShapeError: the memory belongs to another number of cells.
        """
        n_cells = packs.n_cells
        if memory is not None and (
            memory.mean.shape != (STATES, n_cells) or memory.cov.shape != (STATES, STATES, n_cells)
        ):
            raise ShapeError("memory", (STATES, n_cells), memory.mean.shape)
        self._ocv = cell.ocv
        self._drop_ohm = float(cell.lasting_ohm(25.0))
        self._capacity_as = cell.capacity_ah * SECONDS_PER_HOUR
        self._packs = packs
        self._mean = np.zeros((STATES, 2, n_cells))
        self._cov = np.zeros((STATES, STATES, 2, n_cells))
        self._cov[X, X] = START_SIGMA**2
        self._cov[SLOW, SLOW] = self._cov[SLOWER, SLOWER] = SLOW_START_V**2
        self._cov[LEAK, LEAK], self._cov[CAPACITY, CAPACITY] = LEAK_PRIOR_A**2, CAPACITY_PRIOR**2
        self._reading_s = float("nan")
        self._soc = float("nan")
        self._evidence_s = 0.0
        self._since_reading_s = READING_S
        self.soc = np.full(n_cells, np.nan)
        if memory is not None:
            self._reading_s, self._soc, self._evidence_s = memory.time_s, memory.soc, memory.evidence_s
            self._mean[:, LASTING], self._cov[:, :, LASTING] = memory.mean, memory.cov
            self._mean[CAPACITY, QUICK] = memory.mean[CAPACITY]
            self._cov[CAPACITY, CAPACITY, QUICK] = memory.cov[CAPACITY, CAPACITY]
        self._pair_a = 0.0
        self._still_s = 0.0
        self._slow_a = 0.0  # mean current magnitude of the last MEAN_S
        self._time_s = self._reading_s
        self._passed_s = 0.0  # since the last reading, by the steps: the labels' clock may be set meanwhile
        self._unheard_s = 0.0  # without a current
        self._has_begun = False
        self._flowed_as = self._flow_as = 0.0  # since the last reading, with sign and without
        self._is_gap = memory is not None
        self._bleeds = np.zeros(n_cells, dtype=np.bool_)
        self._first_v: FloatArray = np.zeros(n_cells)
        self._begin()

    @property
    def looked_s(self) -> float:
        """Return the time of the last reading [s]; NaN before the first."""
        return self._reading_s

    @property
    def evidence_s(self) -> float:
        """Seconds from the first reading to the last, earlier sessions included."""
        return self._evidence_s

    @property
    def mean_current_a(self) -> float:
        """Mean magnitude of the current of the last MEAN_S [A]."""
        return self._slow_a

    @property
    def memory(self) -> ChargeMemory | None:
        """Return the state to keep for the next session; None before the first reading."""
        if not np.isfinite(self._reading_s):
            return None
        mean, cov = self._mean[:, LASTING].copy(), self._cov[:, :, LASTING].copy()
        return ChargeMemory(self._reading_s, self._evidence_s, self._soc, mean, cov)

    def step(
        self,
        time_s: float,
        dt_s: float,
        current_a: float,
        voltages_v: FloatArray,
        balancing: BoolArray | None = None,
        resistance_excess: FloatArray | None = None,
    ) -> bool:
        """Take one sample; True where a reading was made.

        Args:
            time_s: when it was measured [s]; it counts after a restart and where dt_s is not known.
            dt_s: since the one before, 0 = not known [s].
            current_a: positive on discharge [A].
            voltages_v: (n_cells,) [V]; NaN = missing.
            balancing: (n_cells,) cells that are bled; None = not known.
            resistance_excess: (n_cells,) resistance against the typical one, less one; NaN or None = not known.

        Raises:
            EstimatorError: dt_s is negative or not finite.
        """
        check_step(dt_s)
        # max takes the 0 where a label is NaN: nothing is known before the first sample
        passed_s = dt_s if dt_s > 0.0 and self._has_begun else max(0.0, time_s - self._time_s)
        self._has_begun, self._time_s = True, time_s
        self._passed_s += passed_s
        if not abs(current_a) < 1e9:
            self._unheard_s += passed_s
            return False
        passed_s, self._unheard_s = passed_s + self._unheard_s, 0.0
        if passed_s > GAP_S:
            self._is_gap = True
            self._begin()
        self._pair_a += (1.0 - exp(-dt_s / PAIR_S)) * (current_a - self._pair_a)
        self._slow_a += (1.0 - exp(-dt_s / MEAN_S)) * (abs(current_a) - self._slow_a)
        self._still_s = self._still_s + dt_s if abs(current_a) < REST_A else 0.0
        self._flowed_as += current_a * dt_s
        self._flow_as += abs(current_a) * dt_s
        if balancing is not None:
            self._bleeds |= balancing
        if COASTING_S < self._still_s < SETTLED_S:
            self._begin()  # neither rest nor drive
            return False
        if self._span_s == 0.0:
            self._first_v = voltages_v
        row = np.array((1.0, current_a, self._pair_a))
        self._inputs += np.outer(row, row)
        self._outputs += row[:, None] * voltages_v
        self._squares += np.square(voltages_v - self._first_v)
        self._span_s += dt_s
        if self._span_s < READING_S:
            return False
        is_made = self._take_reading(resistance_excess)
        self._begin()
        return is_made

    def forget(self, cells: BoolArray, *, leak: bool = False) -> None:
        """Reset the charge, and the leak, of some cells, (n_cells,): what they showed was not theirs."""
        self._begin_with(X, cells, START_SIGMA)
        if leak:
            self._begin_with(LEAK, cells, LEAK_PRIOR_A)
        self._outputs[:, cells] = np.nan  # outputs of the current reading

    def _begin_with(self, state: int, cells: BoolArray, sigma: float | FloatArray) -> None:
        self._mean[state][:, cells] = 0.0
        for other in range(STATES):
            self._cov[state, other][:, cells] = self._cov[other, state][:, cells] = 0.0
        self._cov[state, state][:, cells] = np.square(sigma)

    def drift(self) -> ChargeDrift:
        """Return what is known now."""
        g = np.maximum(self._mean[CAPACITY], -0.5)
        lost = 1.0 - 1.0 / (1.0 + g)
        lost_sigma = np.sqrt(self._cov[CAPACITY, CAPACITY] / (1.0 + g) ** 4 + CAPACITY_SIGMA**2)
        leak = self._mean[LEAK]
        scatter = 1.4826 * np.nanmedian(np.abs(leak), axis=1)[:, None]
        shape_a = CAPACITY_SHAPE * np.abs(g) * self._slow_a
        noise = np.sqrt(self._cov[LEAK, LEAK] + scatter**2 + shape_a**2)
        certainty, sigma = leak / noise, np.hypot(noise, LEAK_SIGMA_FRAC * leak)
        is_quick = certainty[QUICK] > np.maximum(certainty[LASTING], QUICK_SIGMAS)
        chosen = np.where(is_quick, QUICK, LASTING), np.arange(leak.shape[1])
        warier = np.argmin(lost / lost_sigma, axis=0), np.arange(leak.shape[1])
        return ChargeDrift(leak[chosen], sigma[chosen], noise[chosen], lost[warier], lost_sigma[warier])

    def _begin(self) -> None:
        """Begin a reading."""
        n = self._mean.shape[2]
        self._span_s: float = 0.0
        self._inputs = np.zeros((3, 3))
        self._outputs = np.zeros((3, n))
        self._squares = np.zeros(n)
        self._first_v = np.zeros(n)

    def _take_reading(self, resistance_excess: FloatArray | None) -> bool:
        n = self._inputs[0, 0]
        if n < SAMPLES_MIN:
            return False
        is_rest = self._still_s >= SETTLED_S
        if is_rest:
            ocv_v = self._outputs[0] / n
            scatter_v2 = np.maximum(self._squares / n - np.square(ocv_v - self._first_v), 0.0)
            noise_v = np.sqrt(REST_V**2 + NOISE_SHARE * scatter_v2)
        else:
            spread_a = np.sqrt(max(self._inputs[1, 1] / n - (self._inputs[0, 1] / n) ** 2, 0.0))
            if spread_a < EXCITED_A:
                return False
            ocv_v = np.linalg.solve(self._inputs + 1e-6 * np.eye(3), self._outputs)[0]
            noise_v = np.full_like(ocv_v, DRIVE_V)
        soc = self._ocv.soc_at(ocv_v)
        self.soc = np.where(np.isfinite(soc), soc, self.soc)
        soc = np.where((soc >= SOC_MIN) & (soc <= SOC_MAX), soc, np.nan)
        middle = self._packs.median(soc)
        apart = soc - middle
        slope = np.maximum(self._ocv.slope(np.nan_to_num(soc, nan=0.5)), 1e-3)
        finite = soc[np.isfinite(soc)]
        if not finite.size:
            return False
        self._predict(float(np.median(finite)), resistance_excess)
        variance = (noise_v / slope) ** 2 + (OCV_SHAPE * apart) ** 2
        self._update(apart, slope, variance)
        return True

    def _predict(self, soc: float, resistance_excess: FloatArray | None) -> None:
        """Go on from the last reading to this one."""
        before_s, before = self._reading_s, self._soc
        self._reading_s, self._soc = self._time_s, soc
        passed_s, self._passed_s = self._passed_s, 0.0
        flowed_as, self._flowed_as = self._flowed_as, 0.0
        is_gap, self._is_gap = self._is_gap, False
        bleeds = self._packs.has_more_than(0.0, self._bleeds)
        self._bleeds[:] = False
        if not np.isfinite(before_s):
            return
        dt_s = self._since_reading_s = passed_s
        self._evidence_s += dt_s
        noise = np.full(self._mean.shape[1:], (COUNT_FRAC * flowed_as / self._capacity_as) ** 2)
        if is_gap:
            moved = before - soc
            flowed_as = moved * self._capacity_as
            noise += LOST_SIGMA**2 if abs(moved) > MOVED_FRAC else 0.0
        noise += np.where(bleeds, (BLEED_A * dt_s / self._capacity_as) ** 2, 0.0)
        decay = np.exp(-dt_s / SLOW_S)
        by_leak, by_capacity = -dt_s / self._capacity_as, -flowed_as / self._capacity_as
        transition = np.diag((1.0, 1.0, 1.0, *decay))
        transition[X, LEAK], transition[X, CAPACITY] = by_leak, by_capacity
        self._mean = np.einsum("ij,jfn->ifn", transition, self._mean)
        self._cov = np.einsum("ij,jkfn,lk->ilfn", transition, self._cov, transition)
        excess = 0.0 if resistance_excess is None else np.maximum(np.nan_to_num(resistance_excess) - LIKE, 0.0)
        flow_a = abs(flowed_as) / dt_s if is_gap and dt_s > 0.0 else self._flow_as / max(dt_s, READING_S)
        self._flow_as = 0.0
        slow_v = SLOW_FLOOR_V + (SLOW_OHM + SLOW_FRAC_OHM * excess) * flow_a
        self._cov[X, X] += noise
        for state, left in zip((SLOW, SLOWER), decay.tolist(), strict=True):
            self._cov[state, state] += (1.0 - left * left) * np.square(slow_v)
        self._cov[LEAK, LEAK] += LEAK_WALK_A2 * dt_s

    def _update(self, apart: FloatArray, slope: FloatArray, variance: FloatArray) -> None:
        """Learn from one reading; a cell without a voltage learns nothing."""
        row = np.zeros((STATES, len(apart)))
        row[X], row[LEAK], row[SLOW], row[SLOWER] = 1.0, -self._drop_ohm / slope, 1.0 / slope, 1.0 / slope
        missed = np.where(np.isfinite(apart), apart, np.nan) - np.einsum("in,ifn->fn", row, self._mean)
        self._may_be_step(row, missed[QUICK], variance)
        column = np.einsum("ijfn,jn->ifn", self._cov, row)
        total = np.einsum("in,ifn->fn", row, column) + variance
        gain = np.where(np.isfinite(apart), column / total, 0.0)
        missed = np.nan_to_num(missed)
        self._mean = self._mean + gain * missed
        self._cov = self._cov - gain[:, None] * column[None]
        self._confirm_step()

    def _may_be_step(self, row: FloatArray, missed: FloatArray, variance: FloatArray) -> None:
        """Widen the quick filter's leak where a reading is far from what it expected: a leak may just have begun."""
        total = np.einsum("in,ijn,jn->n", row, self._cov[:, :, QUICK], row) + variance
        is_surprise = np.nan_to_num(np.square(missed) / total) > SURPRISE_SIGMAS**2
        rate_a = missed * self._capacity_as / max(self._since_reading_s, READING_S)
        self._cov[LEAK, LEAK, QUICK] += np.where(is_surprise, np.square(rate_a), 0.0)

    def _confirm_step(self) -> None:
        """Let the lasting filter go on from the quick one where that is sure of a leak that the other does not see."""
        apart_a = np.abs(self._mean[LEAK, QUICK] - self._mean[LEAK, LASTING])
        is_sudden = apart_a > SUDDEN_SIGMAS * np.sqrt(self._cov[LEAK, LEAK].sum(axis=0))
        self._mean[:, LASTING, is_sudden] = self._mean[:, QUICK, is_sudden]
        self._cov[:, :, LASTING, is_sudden] = self._cov[:, :, QUICK, is_sudden]
