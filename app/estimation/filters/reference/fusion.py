"""What is reported: sigma, fusion with the charge count, self-check."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.filters.reference.output import Output
from app.estimation.filters.reference.state import SLOPE_FLOOR_V, SOC_VARIANCE_MAX, Motion, State
from app.estimation.filters.setup import FilterSetup


def soc_variance(setup: FilterSetup, state: State, output: Output) -> FloatArray:
    """Return (n,) variance of the filter's SOC with the error that averaging does not remove.

    v_f = P_zz + (bias^2 + mean square of the lasting innovation) / slope^2: a model that errs is trusted less.
    """
    slope_v2 = np.maximum(output.ocv_slope_v**2, SLOPE_FLOOR_V**2)
    variance = state.cov[0, 0] + (setup.tuning.bias_v**2 + state.slow_square_v2) / slope_v2
    return np.asarray(np.minimum(variance, SOC_VARIANCE_MAX))


def fuse(
    setup: FilterSetup, state: State, motion: Motion, filter_v2: FloatArray
) -> tuple[State, FloatArray, FloatArray]:
    """Return the state, and (n,) SOC and variance of the filter fused with the charge count.

    The filter starts from voltage alone: two independent estimates of the SOC. While they agree the surer one counts:
    by the squares of their variances, steeper than the precision-weighted mean, since the errors of a model last and do
    not average out against those of a count. When they contradict each other the start was wrong, and the filter rules;
    a count that stays contradicted is anchored anew. Within minutes a count cannot wander, whatever its start: how far
    the filter wanders against it is an error it does not know of.

        v_f = v_filter + S,  S' = S + a (1 - a) (f (d - m)^2 - S),  m' = m + a (d - m),  a = 1 - exp(-dt / wander_s)
        v_c = v_anchor + gain^2 + offset^2
        v_t = min(v_f + v_c, doubt_soc^2)
        w   = P(start was right | both)                   from t(d; 0, v_t) against "anywhere in 0..1"
        z   = z_f - w g d,  g = v_f^2 / (v_f^2 + v_c^2),  d = z_f - z_c
        v   = v_f + w g (v_c - v_f + (1 - w) g d^2)       no less than either's where their errors are the same

    t is Student's density with 31 degrees of freedom: (1 + d^2 / 32 v_t)^-16, tails a little heavier than normal.

    Args:
        setup: the filter.
        state: after the update.
        motion: the step.
        filter_v2: (n,) variance of the filter's SOC.
    """
    tuning = setup.tuning
    a = motion.share(tuning.wander_s)
    odds = tuning.start_unknown / (1.0 - tuning.start_unknown) * math.sqrt(2.0 * math.pi)
    d, count_v2 = state.soc - state.count_soc, state.count_v2
    beyond = d - state.apart
    wander_v2 = state.wander_v2 + a * (1.0 - a) * (tuning.wander_factor * beyond**2 - state.wander_v2)
    filter_v2 = np.minimum(filter_v2 + wander_v2, SOC_VARIANCE_MAX)
    total_v2 = np.minimum(filter_v2 + count_v2, tuning.doubt_soc**2)
    w = 1.0 / (1.0 + odds * np.sqrt(total_v2) * (1.0 + d**2 / (32.0 * total_v2)) ** 16)
    g = filter_v2**2 / (filter_v2**2 + count_v2**2)
    soc = state.soc - w * g * d
    variance = filter_v2 + w * g * (count_v2 - filter_v2 + (1.0 - w) * g * d**2)
    doubt_s = np.where(w < 0.5, state.doubt_s + motion.dt_s, 0.0)
    anew = doubt_s > tuning.anchor_s
    after = replace(
        state,
        count_soc=np.where(anew, state.soc, state.count_soc),
        count_gain=np.where(anew, 0.0, state.count_gain),
        count_offset=np.where(anew, 0.0, state.count_offset),
        anchor_v2=np.where(anew, tuning.anchor_factor * filter_v2, state.anchor_v2),
        doubt_s=np.where(anew, 0.0, doubt_s),
        apart=np.where(anew, 0.0, state.apart + a * beyond),
        wander_v2=wander_v2,
    )
    return after, soc, variance


def self_check(
    setup: FilterSetup, state: State, motion: Motion, nu: FloatArray, counts: BoolArray
) -> tuple[State, BoolArray]:
    """Return the state, and (n,) True while the model describes the cell.

        m' = m + (1 - exp(-dt / T)) (y - m)         of y = nu sqrt(r_0 / r), the innovation scaled to rest

    over `check_s` for y and y^2, over `bias_s` for y, and over `check_s` again for the square of that: an innovation
    that does not average out is an error that the filter takes for charge.

    Args:
        setup: the filter.
        state: after the fusion.
        motion: the step.
        nu: (n,) innovations [V].
        counts: (n,) False where the sample is missing or was refused: it says nothing about the model.
    """
    tuning = setup.tuning
    y = np.where(counts, nu * tuning.model_error_v / math.sqrt(motion.noise_v2), 0.0)
    share = np.where(counts, motion.share(tuning.check_s), 0.0)
    bias_share = np.where(counts, motion.share(tuning.bias_s), 0.0)
    after = replace(
        state,
        check_mean_v=state.check_mean_v + share * (y - state.check_mean_v),
        check_square_v2=state.check_square_v2 + share * (y**2 - state.check_square_v2),
        slow_mean_v=state.slow_mean_v + bias_share * (y - state.slow_mean_v),
        slow_square_v2=state.slow_square_v2 + share * (state.slow_mean_v**2 - state.slow_square_v2),
    )
    is_small = after.check_square_v2 < tuning.check_rms_v**2
    return after, is_small & (np.abs(after.check_mean_v) < tuning.check_bias_v)
