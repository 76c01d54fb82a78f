"""Resistance of every cell from single steps of the current: a joint that parts within a second shows in one of them.

    d = v(t) - v(t - LAG_S),   d_cell = r d_typical       where the current moved by STEP_A or more

Against the typical cell, filters and delays of the measurement cancel; r is the resistance over the typical one.
A regression over half a minute needs half a minute; a trip leaves one step, the opening of the relays.

A joint that parts within a step to more current drops by r I, not by r dI: 48 mohm were read where 14 were true. So
what a cell drops by more than the typical one counts as if it parted there, |dI / I| of it: never more than is true.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray

LAG_S: Final = 0.4
LAG_MAX_S: Final = 0.8
STEP_A: Final = 20.0
BURST_S: Final = 1.5  # without a step: the next one is judged by itself
MEMORY: Final = 4.0  # differences: the first of a step may still hold what was before a joint parted
COUNT_MIN: Final = 2.5


class StepResistance:
    """Call `step` with every sample."""

    def __init__(self, n_cells: int) -> None:
        self._before: deque[tuple[float, float, FloatArray]] = deque(maxlen=64)
        self._time_s = 0.0
        self._learned_s = -np.inf
        self._rises = False
        self._sums = np.zeros((3, n_cells))  # of the typical cell's and the cell's difference: x x, x y, y y [V^2]
        self._count = np.zeros(n_cells)
        self.learned = 0  # differences, in all

    def step(self, dt_s: float, current_a: float, voltages_v: FloatArray) -> None:
        """Take one sample: step [s], current [A] positive on discharge, (n_cells,) voltages [V]; NaN = missing."""
        if not abs(current_a) < 1e9:
            return
        self._time_s += dt_s
        while len(self._before) > 1 and self._time_s - self._before[1][0] >= LAG_S:
            self._before.popleft()
        if self._before:
            then_s, then_a, then_v = self._before[0]
            if LAG_S <= self._time_s - then_s <= LAG_MAX_S and abs(current_a - then_a) >= STEP_A:
                share = min(abs((current_a - then_a) / current_a), 1.0) if abs(current_a) > abs(then_a) else 1.0
                self._learn(then_v - voltages_v, share, rises=current_a > then_a)
        self._before.append((self._time_s, current_a, voltages_v))

    def ratio(self) -> FloatArray:
        """Return (n_cells,) resistance over the typical cell's in the last step; NaN while not known."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self._count >= COUNT_MIN, self._sums[1] / self._sums[0], np.nan)

    def sigma(self) -> FloatArray:
        """Return (n_cells,) its standard deviation by the scatter about the line."""
        xx, xy, yy = self._sums
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.maximum(yy - xy * xy / xx, 0.0)
            return np.where(self._count >= COUNT_MIN, np.sqrt(left / xx), np.nan)

    def _learn(self, dropped_v: FloatArray, share: float, *, rises: bool) -> None:
        known = np.isfinite(dropped_v)
        if not known.any():
            return
        if self._time_s - self._learned_s > BURST_S or rises != self._rises:  # the joint may part within a step, too
            self._rises = rises
            self._sums[:] = 0.0
            self._count[:] = 0.0
        self._learned_s = self._time_s
        x = float(np.median(dropped_v[known]))
        y = np.where(known, x + share * (dropped_v - x), 0.0)
        fade = np.where(known, 1.0 - 1.0 / MEMORY, 1.0)
        self._sums *= fade
        self._sums += known * np.array((np.full_like(y, x * x), x * y, y * y))
        self._count = self._count * fade + known
        self.learned += 1
