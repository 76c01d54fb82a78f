"""A filter that starts from voltage alone, fused with a charge count: two independent witnesses of the SOC.

While they agree the fusion is their precision-weighted mean: what a filter with the right prior would say. When
they contradict each other the start was wrong, and the filter rules; a count that stays contradicted is anchored
anew.

    v_c = v_anchor + (gain q)^2 + (offset t)^2        over charge q and time t: gain and offset are constants
    w   = P(start was right | both)                   from t(d; 0, v_f + v_c) against "anywhere in 0..1"
    z   = z_f - w g d,  g = v_f / (v_f + v_c),  d = z_f - z_c
    v   = v_f (1 - w g) + w (1 - w) g^2 d^2

t is Student's density with 31 degrees of freedom: (1 + d^2 / 32 v)^-16, tails a little heavier than normal and no
exponential to compute.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from app.estimation.circuit import SECONDS_PER_HOUR
from app.estimation.states import SOC, CellStates
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]


def move_count(state: CellStates, tuning: Tuning, moved_soc: float, dt_s: float) -> None:
    """Take a share of the capacity out of every cell's count, and let its sigmas grow."""
    drift = tuning.counter_gain * moved_soc, (tuning.counter_offset_c / SECONDS_PER_HOUR) * dt_s
    state.count += np.array([[-moved_soc], [drift[0]], [drift[1]]])


def count_variance(state: CellStates) -> FloatArray:
    """Return (n,) variance of the counted SOC."""
    drift = state.count[1:]
    squares = drift * drift
    return np.asarray(squares[0] + squares[1] + state.anchor_v2)


def fuse(state: CellStates, tuning: Tuning, dt_s: float, filter_v2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (n,) fused SOC and variance; anchors the count anew where it has been contradicted too long.

    Args:
        state: filter mean and count.
        tuning: probabilities and times.
        dt_s: step [s].
        filter_v2: (n,) variance of the filter's SOC, model error included.
    """
    filter_soc = state.mean[SOC]
    total = count_variance(state)
    total += filter_v2
    d = filter_soc - state.count[0]
    dd = d * d
    tail = dd / total
    tail *= 1.0 / 32.0
    tail += 1.0
    for _ in range(4):
        tail *= tail
    tail *= np.sqrt(total)
    tail *= unknown_odds(tuning)
    tail += 1.0
    w = 1.0 / tail
    g = filter_v2 / total
    wg = w * g
    soc = filter_soc - wg * d
    # v = v_f - w g (v_f - (1 - w) g d^2)
    variance = filter_v2 - wg * (filter_v2 - (1.0 - w) * (g * dd))
    doubted = w < 0.5
    if doubted.any():
        state.doubt_s[:] = np.where(doubted, state.doubt_s + dt_s, 0.0)
        anchor = state.doubt_s > tuning.anchor_s
        np.copyto(state.count_soc, filter_soc, where=anchor)
        np.copyto(state.count[1:], 0.0, where=anchor)
        np.copyto(state.anchor_v2, filter_v2, where=anchor)
        np.copyto(state.doubt_s, 0.0, where=anchor)
    else:
        state.doubt_s[:] = 0.0
    return soc, variance


def unknown_odds(tuning: Tuning) -> float:
    """Return the odds that a start SOC is wrong, over the height of a density of unit variance."""
    return tuning.start_unknown / (1.0 - tuning.start_unknown) * math.sqrt(2.0 * math.pi)
