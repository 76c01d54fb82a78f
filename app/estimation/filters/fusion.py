"""A filter that starts from voltage alone, fused with a charge count: two independent estimates of the SOC.

While they agree the surer one counts: by the squares of their variances, steeper than the precision-weighted mean,
since the errors of a model last and do not average out against those of a count. When they contradict each other the
start was wrong, and the filter rules; a count that stays contradicted is anchored anew. Within minutes a count cannot
wander, whatever its start: how far the filter wanders against it is an error that the filter does not know of.

    v_f = v_filter + S,  S' = S + a (1 - a) (f (d - m)^2 - S),  m' = m + a (d - m),  a = 1 - exp(-dt / wander_s)
    v_c = v_anchor + (gain q)^2 + (offset t)^2        over charge q and time t: gain and offset are constants
    v_t = min(v_f + v_c, doubt_soc^2)
    w   = P(start was right | both)                   from t(d; 0, v_t) against "anywhere in 0..1"
    z   = z_f - w g d,  g = v_f^2 / (v_f^2 + v_c^2),  d = z_f - z_c
    v   = v_f + w g (v_c - v_f + (1 - w) g d^2)        no less than either's where their errors are the same

t is Student's density with 31 degrees of freedom: (1 + d^2 / 32 v_t)^-16, tails a little heavier than normal and no
exponential to compute.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.filters.process import SOC_VARIANCE_MAX
from app.estimation.filters.states import CellStates
from app.estimation.filters.tuning import Tuning

ONE: Final = np.array(1.0)
VARIANCE_MAX: Final = np.array(SOC_VARIANCE_MAX)
PER_TAIL: Final = np.array(1.0 / 32.0)


class Mixer:
    """Mixes arrays of one shape; results are good until the next call.

    Attributes:
        count_v2: (shape) where the variance of the count is put before.
        filter_v2: (shape) where that of the filter is, model error and wandering included.
    """

    def __init__(self, shape: tuple[int, ...], tuning: Tuning) -> None:
        self._odds = np.array(unknown_odds(tuning))
        self._total_max = np.array(tuning.doubt_soc * tuning.doubt_soc)
        upper, lower, ratios = np.empty((3, 2, *shape))
        self._views = upper, lower, ratios, *ratios, *np.empty((2, *shape))
        self._d2, self.count_v2 = upper
        self._total_v2, self.filter_v2 = lower

    def mix(self, filter_soc: FloatArray, d: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return fused SOC and variance, new arrays, and the odds w that the start was right.

        Args:
            filter_soc: (shape) the filter's SOC.
            d: (shape) how far it lies above the count's.
        """
        upper, lower, ratios, w, g, share, left = self._views
        d2, count_v2, total, filter_v2 = self._d2, self.count_v2, self._total_v2, self.filter_v2
        np.add(count_v2, filter_v2, total)
        np.minimum(total, self._total_max, out=total)
        np.multiply(d, d, d2)
        # d^2 / v_t and v_c / v_f: 1 / w - 1 = odds sqrt(v_t) (1 + d^2 / 32 v_t)^16, and 1 / g - 1 is a square
        np.divide(upper, lower, ratios)
        np.multiply(w, PER_TAIL, w)
        np.add(w, ONE, w)
        for _ in range(3):
            np.multiply(w, w, w)
        np.multiply(ratios, ratios, ratios)
        np.sqrt(total, left)
        np.multiply(left, self._odds, left)
        np.multiply(w, left, w)
        np.add(ratios, ONE, ratios)
        np.reciprocal(ratios, ratios)
        # v = v_f + w g (v_c - v_f + (g - w g) d^2)
        np.multiply(w, g, share)
        np.subtract(g, share, g)
        np.multiply(g, d2, g)
        np.subtract(count_v2, filter_v2, left)
        np.add(left, g, left)
        np.multiply(left, share, left)
        # z = z_f - w g d
        np.multiply(share, d, share)
        return np.subtract(filter_soc, share), np.add(filter_v2, left), w


class Fusion:
    """Fuses the filter of one state with its charge count."""

    def __init__(self, states: CellStates, tuning: Tuning) -> None:
        self._states = states
        self._tuning = tuning
        self._mixer = Mixer((states.n_cells,), tuning)
        self._block_mixer: Mixer | None = None
        self._dt_s = math.nan
        self._wander_factor = np.array(tuning.wander_factor)
        self._gap = np.empty(states.n_cells)
        self._moved, self._shares = np.empty((2, 2, states.n_cells))
        self._wander_views = *self._moved, states.apart, states.wander, states.wander_v2

    def fuse(self, dt_s: float, filter_soc: FloatArray, filter_v2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (n,) fused SOC and variance; anchors the count anew where it has been contradicted too long.

        Args:
            dt_s: step [s].
            filter_soc: (n,) the filter's SOC.
            filter_v2: (n,) its variance, model error included.
        """
        states, mixer, gap = self._states, self._mixer, self._gap
        np.subtract(filter_soc, states.count_soc, gap)
        self._wander(dt_s, gap)
        total_filter_v2 = mixer.filter_v2
        np.add(filter_v2, states.wander_v2, total_filter_v2)
        np.minimum(total_filter_v2, VARIANCE_MAX, out=total_filter_v2)
        count_variance(states.drift, states.anchor_v2, mixer.count_v2)
        soc, variance, w = mixer.mix(filter_soc, gap)
        if w.item(w.argmin()) < 0.5:
            self._doubt(dt_s, w < 0.5, filter_soc, total_filter_v2)
        else:
            states.doubt_s.fill(0.0)
        return soc, variance

    def fuse_block(
        self, dt_s: list[float], filter_soc: FloatArray, filter_v2: FloatArray, counts: FloatArray, before: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return (k, n) fused SOC and variance of k samples in a row.

        Where a start is likely to be wrong the count may be anchored anew, and what follows then depends on it: those
        blocks are fused sample by sample.

        Args:
            dt_s: k steps [s].
            filter_soc: (k, n) the filter's SOC.
            filter_v2: (k, n) its variance, model error included.
            counts: (k, 3, n) the count after each step, not anchored meanwhile.
            before: (3, n) the count before the first.
        """
        states, shape = self._states, filter_soc.shape
        mixer = self._block_mixer
        if mixer is None or mixer.count_v2.shape != shape:
            mixer = self._block_mixer = Mixer(shape, self._tuning)
        np.add(counts[:, 1] * counts[:, 1] + counts[:, 2] * counts[:, 2], states.anchor_v2, mixer.count_v2)
        wander_before = states.wander.copy()
        gaps = filter_soc - counts[:, 0]
        total_filter_v2 = mixer.filter_v2
        for dt, one, row in zip(dt_s, gaps, total_filter_v2, strict=True):
            self._wander(dt, one)
            row[...] = states.wander_v2
        np.add(total_filter_v2, filter_v2, total_filter_v2)
        np.minimum(total_filter_v2, VARIANCE_MAX, out=total_filter_v2)
        soc, variance, w = mixer.mix(filter_soc, gaps)
        if not (w < 0.5).any():
            states.doubt_s.fill(0.0)
            return soc, variance
        np.copyto(states.wander, wander_before)
        moved = np.diff(counts, axis=0, prepend=before[None])
        np.copyto(states.count, before)
        for k, dt in enumerate(dt_s):
            np.add(states.count, moved[k], states.count)
            soc[k], variance[k] = self.fuse(dt, filter_soc[k], filter_v2[k])
        return soc, variance

    def _wander(self, dt_s: float, d: FloatArray) -> None:
        """Follow the mean of d = z_f - z_c, and what the mean square of d beyond it tells of the filter's error."""
        if dt_s != self._dt_s:
            share = 1.0 - math.exp(-dt_s / self._tuning.wander_s)
            self._dt_s = dt_s
            self._shares[:] = [[share], [share * (1.0 - share)]]
        beyond, beyond2, apart, wander, wander_v2 = self._wander_views
        moved = self._moved
        np.subtract(d, apart, beyond)
        np.multiply(beyond, self._wander_factor, beyond2)
        np.multiply(beyond2, beyond, beyond2)
        np.subtract(beyond2, wander_v2, beyond2)
        np.multiply(moved, self._shares, moved)
        np.add(wander, moved, wander)

    def _doubt(self, dt_s: float, doubted: BoolArray, filter_soc: FloatArray, filter_v2: FloatArray) -> None:
        state = self._states
        doubt_s = state.doubt_s
        doubt_s[:] = np.where(doubted, doubt_s + dt_s, 0.0)
        anchor = doubt_s > self._tuning.anchor_s
        np.copyto(state.count_soc, filter_soc, where=anchor)
        np.copyto(state.count[1:], 0.0, where=anchor)
        np.copyto(state.anchor_v2, self._tuning.anchor_factor * filter_v2, where=anchor)
        np.copyto(state.apart, 0.0, where=anchor)
        np.copyto(doubt_s, 0.0, where=anchor)


def count_variance(drift: FloatArray, anchor_v2: FloatArray, out: FloatArray | None = None) -> FloatArray:
    """Return the variance of a counted SOC, in `out` or a new array.

    Args:
        drift: (2, ...) sigmas that gain and offset of the sensor have given the count.
        anchor_v2: (n,) variance of the SOC where the count began.
        out: (...) where it goes.
    """
    squares = np.square(drift)
    total: FloatArray = np.add(squares[0], squares[1], out)
    np.add(total, anchor_v2, total)
    return total


def unknown_odds(tuning: Tuning) -> float:
    """Return the odds that a start SOC is wrong, over the height of a density of unit variance."""
    return tuning.start_unknown / (1.0 - tuning.start_unknown) * math.sqrt(2.0 * math.pi)
