"""Resistance of every cell while the car drives.

Every cell's voltage is regressed on the common current and on the current through an RC pair. No OCV and no SOC enter,
so a wrong SOC changes no resistance. Only samples in which the current moves teach anything, and only they let older
ones fade: what was learned stays as it was while the car stands.
"""

from __future__ import annotations

from math import exp
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.errors import ShapeError, check_step

PAIR_S: Final = 10.0  # time constant of the RC pair in the regression; cells in parallel cans lie at 8 to 20 s
DRIFT_S: Final = 40.0  # slower than this is SOC and heat and is taken away from all signals alike
MEMORY_S: Final = 60.0  # time of the regression: about one lap of a Formula Student track
RESTART_S: Final = 2.0  # after a hole this long the signals restart
SETTLE_S: Final = 30.0  # after a start: the pair's current was not known then and has to be forgotten
AVERAGE_S: Final = DRIFT_S  # after that the drift is the mean of all samples: one alone would leave its noise in all
BLOCK: Final = 64  # samples taken at once; RESTART_S each, they last 13 PAIR_S: exp of that is a number
EXCITED_A: Final = 3.0  # a current nearer to its slow mean than this is noise and moves no resistance
STANDING_A: Final = 2.0  # below it the car stands ...
STANDING_S: Final = 5.0  # ... after this long: what follows is slow recovery
SET_NOISE_V: Final = 2e-3  # voltage of samples that a resistance was set for
SAMPLES_MIN: Final = 20.0  # effective number of samples below which nothing is known


class ResistanceTracker:
    """Regression of every cell's voltage on current and RC current, with fading memory.

    Call `step` with every sample (about 20 us for 96 cells), or `take` with many; read the resistances at leisure.
    """

    def __init__(self, n_cells: int, pair_s: float = PAIR_S, memory_s: float = MEMORY_S) -> None:
        """Prepare for n_cells; `pair_s` [s] is the pair's time constant, `memory_s` [s] that of fading samples."""
        self.n_cells = n_cells
        self._pair_s = pair_s
        self._memory_s = memory_s
        self._drift_v = np.zeros(n_cells)
        self._drift_a = self._drift_pair_a = self._pair_a = 0.0
        self._sums = np.zeros((6, n_cells))  # weights times x x, x p, p p [A^2], x y, p y [V A], y y [V^2]
        self._weight = np.zeros((2, n_cells))  # sums of weights and of their squares, in samples
        self._y = np.empty(n_cells)
        self._new = np.empty((6, n_cells))
        self._since_s: float | None = None
        self._still_s = float("inf")  # since there was a current
        self._age_s = float("inf")
        self._learned_s = 0.0
        self._moved = (0.0, 0.0)  # current and pair's current against their drift, at the last sample
        self._last_v: FloatArray | None = None
        self._gains: tuple[float, float, float, float] = (-1.0, 0.0, 0.0, 0.0)
        self._has_unknown = False
        self._has_settled = False
        self._averaged_s = 0.0  # time of samples in the drift, until AVERAGE_S

    @property
    def learned_s(self) -> float:
        """Seconds of samples that taught something, in all."""
        return self._learned_s

    @property
    def age_s(self) -> float:
        """Seconds since the last sample that taught something; infinite before the first."""
        return self._age_s

    @property
    def excitation_a(self) -> float:
        """Rms of the current's movement in the samples that are remembered [A]; NaN before there are any."""
        weight = self._weight[0].max()
        return float(np.sqrt(self._sums[0].max() / weight)) if weight > 0.0 else float("nan")

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike) -> None:
        """Take one sample.

        Args:
            dt_s: time since the previous sample, >= 0 [s].
            current_a: positive on discharge [A]; a sample without a finite current is left out.
            voltages_v: (n_cells,) [V]; NaN where not measured.

        Raises:
            ShapeError: voltages_v is not (n_cells,).
            EstimatorError: dt_s is negative or not finite.
        """
        v = np.asarray(voltages_v, dtype=np.float64)
        if v.shape != (self.n_cells,):
            raise ShapeError("voltages_v", (self.n_cells,), v.shape)
        check_step(dt_s)
        self._age_s += dt_s
        if not -1e9 < current_a < 1e9 or dt_s == 0.0:
            return
        self._still_s = 0.0 if abs(current_a) >= STANDING_A else self._still_s + dt_s
        if self._since_s is None or dt_s > RESTART_S:
            self._pair_a, self._since_s, self._has_settled = current_a, 0.0, False
            return
        _, pair, drift, fade = self._gains_for(dt_s)
        if self._has_settled and self._averaged_s < AVERAGE_S:
            self._averaged_s += dt_s
            drift = dt_s / self._averaged_s
        self._pair_a += pair * (current_a - self._pair_a)
        self._since_s += dt_s
        if not self._has_settled:
            if self._since_s >= SETTLE_S:
                self._settle(current_a, v, dt_s)
            return
        self._drift_a += drift * (current_a - self._drift_a)
        self._drift_pair_a += drift * (self._pair_a - self._drift_pair_a)
        x, p = self._moved = current_a - self._drift_a, self._pair_a - self._drift_pair_a
        is_missing = np.isnan(v)
        has_missing = bool(is_missing.any())
        if has_missing or self._has_unknown:
            v = self._filled(v, is_missing, 1.0 - drift)
        y = self._y
        np.subtract(self._drift_v, v, out=y)
        self._drift_v -= drift * y
        y *= 1.0 - drift
        self._last_v = v
        if abs(x) >= EXCITED_A and self._still_s <= STANDING_S:
            self._accumulate(x, p, fade, is_missing if has_missing else None)
            self._age_s = 0.0
            self._learned_s += dt_s

    def take(self, dt_s: FloatArray, current_a: FloatArray, voltages_v: FloatArray) -> None:
        """Take n samples: the same as `step` with each, ten times as fast where nothing is missing.

        Args:
            dt_s: (n,) time since the previous sample, >= 0 [s].
            current_a: (n,) positive on discharge [A]; a sample without a finite current is left out.
            voltages_v: (n, n_cells) [V]; NaN where not measured.

        Raises:
            ShapeError: voltages_v is not (n, n_cells).
            EstimatorError: a dt_s is negative or not finite.
        """
        if voltages_v.shape != (len(dt_s), self.n_cells):
            raise ShapeError("voltages_v", (len(dt_s), self.n_cells), voltages_v.shape)
        is_plain = (dt_s > 0.0) & (dt_s <= RESTART_S) & (np.abs(current_a) < 1e9) & np.isfinite(voltages_v).all(axis=1)
        k = 0
        while k < len(dt_s):
            block = is_plain[k : k + BLOCK]
            n = len(block) if block.all() else int(block.argmin())
            if n > 1 and self._has_settled and self._averaged_s >= AVERAGE_S and not self._has_unknown:
                self._take_plain(dt_s[k : k + n], current_a[k : k + n], voltages_v[k : k + n])
                k += n
            else:
                self.step(float(dt_s[k]), float(current_a[k]), voltages_v[k])
                k += 1

    def adopt(self, other: ResistanceTracker, cells: BoolArray) -> None:
        """Remember of some cells, (n_cells,), what another tracker of the same samples remembers of them."""
        self._sums[:, cells] = other._sums[:, cells]
        self._weight[:, cells] = other._weight[:, cells]

    def set_ohmic(self, ohmic_ohm: FloatArray, cells: BoolArray) -> None:
        """Go on as if some cells, (n_cells,), had always had this ohmic resistance [ohm]: theirs has changed."""
        xx, xp, pp, _, _, _ = self._sums
        pair = np.nan_to_num(self._solved()[0][1])
        xy, py = ohmic_ohm * xx + pair * xp, ohmic_ohm * xp + pair * pp
        noise = SET_NOISE_V**2 * self._weight[0]
        replaced = np.array((xy, py, ohmic_ohm * xy + pair * py + noise))
        self._sums[3:, cells] = replaced[:, cells]
        x, p = self._moved
        if self._last_v is not None:
            self._drift_v[cells] = (self._last_v + ohmic_ohm * x + pair * p)[cells]

    def resistance_ohm(self) -> FloatArray:
        """Return (2, n_cells): ohmic resistance with the joint, and that of the pair [ohm]; NaN while not known."""
        return self._solved()[0]

    def sigma_ohm(self) -> FloatArray:
        """Return (2, n_cells): standard deviations of `resistance_ohm` from the scatter of the regression [ohm]."""
        return self._solved()[1]

    def _solved(self) -> tuple[FloatArray, FloatArray]:
        xx, xp, pp, xy, py, yy = self._sums
        with np.errstate(divide="ignore", invalid="ignore"):
            samples = self._weight[0] ** 2 / self._weight[1]
            determinant = xx * pp - xp * xp
            usable = (samples >= SAMPLES_MIN) & (determinant > 1e-9 * xx * pp)
            ohmic, pair = (pp * xy - xp * py) / determinant, (xx * py - xp * xy) / determinant
            scatter = np.maximum(yy - ohmic * xy - pair * py, 0.0) / self._weight[0]
            variance = scatter / determinant * np.array([pp, xx]) * self._weight[0] / samples
            sigma = np.sqrt(variance)
        if_usable = np.where(usable, 1.0, np.nan)
        return np.array([ohmic, pair]) * if_usable, sigma * if_usable

    def _gains_for(self, dt_s: float) -> tuple[float, float, float, float]:
        if dt_s != self._gains[0]:
            self._gains = (
                dt_s,
                1.0 - exp(-dt_s / self._pair_s),
                1.0 - exp(-dt_s / DRIFT_S),
                exp(-dt_s / self._memory_s),
            )
        return self._gains

    def _settle(self, current_a: float, voltages_v: FloatArray, dt_s: float) -> None:
        self._averaged_s = dt_s
        self._drift_v[:] = voltages_v
        self._drift_a, self._drift_pair_a = current_a, self._pair_a
        self._has_unknown = bool(np.isnan(voltages_v).any())
        self._has_settled = True

    def _filled(self, voltages_v: FloatArray, is_missing: BoolArray, left: float) -> FloatArray:
        """Return the voltages with missing ones at their own drift, so that they move nothing.

        The drift of a cell that comes first now begins where it would be with the resistances of the typical cell, of
        whose drop the share `left` counts.
        """
        fresh = np.isnan(self._drift_v) & ~is_missing
        if fresh.any():
            resistances = self._solved()[0]
            finite = resistances[:, np.isfinite(resistances[0])]
            typical = np.median(finite, axis=1) if finite.size else np.zeros(2)
            self._drift_v[fresh] = voltages_v[fresh] + typical @ self._moved / left
        self._has_unknown = bool(np.isnan(self._drift_v).any())
        return np.where(is_missing, self._drift_v, voltages_v)

    def _take_plain(self, dt_s: FloatArray, current_a: FloatArray, voltages_v: FloatArray) -> None:
        """Samples of which nothing is missing; the low passes of `step` as matrices over the block."""
        time_s = np.cumsum(dt_s)
        pair_a = _low_passed(time_s, dt_s, self._pair_s, np.array([self._pair_a]), current_a[:, None])[:, 0]
        before = np.concatenate((self._drift_v, [self._drift_a, self._drift_pair_a]))
        drifting = np.column_stack((voltages_v, current_a, pair_a))
        drift = _low_passed(time_s, dt_s, DRIFT_S, before, drifting)
        self._pair_a = float(pair_a[-1])
        self._drift_v[:] = drift[-1, : self.n_cells]
        self._drift_a, self._drift_pair_a = drift[-1, self.n_cells :].tolist()
        self._since_s = (self._since_s or 0.0) + float(time_s[-1])
        y = drift[:, : self.n_cells] - voltages_v
        x, p = (drifting - drift)[:, self.n_cells :].T
        still_s = _still_s(time_s, current_a, self._still_s)
        self._still_s = float(still_s[-1])
        teaches = (np.abs(x) >= EXCITED_A) & (still_s <= STANDING_S)
        self._age_s += float(time_s[-1])
        if not teaches.any():
            return
        last = len(teaches) - 1 - int(teaches[::-1].argmax())
        self._age_s = float(time_s[-1] - time_s[last])
        taught_s = np.cumsum(np.where(teaches, dt_s, 0.0))
        self._learned_s += float(taught_s[-1])
        fade = np.where(teaches, np.exp((taught_s - taught_s[-1]) / self._memory_s), 0.0)
        left = exp(-taught_s[-1] / self._memory_s)
        self._weight[0] = self._weight[0] * left + fade.sum()
        self._weight[1] = self._weight[1] * left**2 + (fade**2).sum()
        self._sums *= left
        self._sums[:3] += np.array([fade @ (x * x), fade @ (x * p), fade @ (p * p)])[:, None]
        self._sums[3:] += [(fade * x) @ y, (fade * p) @ y, fade @ (y * y)]

    def _accumulate(self, x: float, p: float, fade: float, is_missing: BoolArray | None) -> None:
        y, new = self._y, self._new
        new[0], new[1], new[2] = x * x, x * p, p * p
        np.multiply(y, x, out=new[3])
        np.multiply(y, p, out=new[4])
        np.multiply(y, y, out=new[5])
        self._weight[0] *= fade
        self._weight[1] *= fade * fade
        self._sums *= fade
        if is_missing is None:
            self._weight += 1.0
        else:
            new[:, is_missing] = 0.0
            self._weight += ~is_missing
        self._sums += new


def _still_s(time_s: FloatArray, current_a: FloatArray, before_s: float) -> FloatArray:
    """Return (n,) the time since there was a current, from what it was before the first sample [s]."""
    flowed_s = np.maximum.accumulate(np.where(np.abs(current_a) >= STANDING_A, time_s, -np.inf))
    return np.where(np.isfinite(flowed_s), time_s - flowed_s, before_s + time_s)


def _low_passed(
    time_s: FloatArray, dt_s: FloatArray, constant_s: float, before: FloatArray, values: FloatArray
) -> FloatArray:
    """Return (n, columns) a first-order low pass over samples at (n,) times, from its (columns,) output before them."""
    decay = np.exp(-time_s / constant_s)
    weights = np.tril(np.outer(decay, (1.0 - np.exp(-dt_s / constant_s)) / decay))
    filtered: FloatArray = decay[:, None] * before + weights @ values
    return filtered
