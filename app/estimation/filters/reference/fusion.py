"""What is reported: sigma, fusion with the charge count, self-check."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.filters.reference.output import Output
from app.estimation.filters.reference.state import (
    SLOPE_FLOOR_V,
    SOC_VARIANCE_MAX,
    Measurement,
    Motion,
    State,
    lasting_v2,
    noise_v2,
)
from app.estimation.filters.setup import FilterSetup
from app.estimation.filters.tables import DROP_ERROR, OCV_ERROR


def soc_variance(setup: FilterSetup, state: State, output: Output) -> FloatArray:
    """Return (n,) variance of the filter's SOC with the error that averaging does not remove.

    v_f = P_zz + (bias^2 + mean square of the lasting innovation) / slope^2: a model that errs is trusted less. The
    slope is that of the sigma points or, if less, of a voltage that is read: in a plateau's step neither may be local.
    """
    variance = state.cov[0, 0] + (setup.tuning.bias_v**2 + state.slow_square_v2) / slope_v2(setup, state, output)
    return np.asarray(np.minimum(variance, SOC_VARIANCE_MAX))


def slope_v2(setup: FilterSetup, state: State, output: Output) -> FloatArray:
    """Return (n,) the square of the slope by which an error of the voltage is one of SOC [V^2]; see `soc_variance`."""
    slope_v = np.minimum(output.ocv_slope_v, setup.cell.reading_slope(state.soc))
    return np.asarray(np.maximum(slope_v**2, SLOPE_FLOOR_V**2))


def fuse(
    setup: FilterSetup, state: State, motion: Motion, measured: Measurement, output: Output, filter_v2: FloatArray
) -> tuple[State, FloatArray, FloatArray]:
    """Return the state, and (n,) SOC and variance of the filter fused with charge counted from every likely start.

    The filter starts from voltage alone. Starts are hypotheses: the SOC that was given is exact, or it is roughly
    right, or the voltage at rest was; or none of them. While a count and the filter agree the surer one counts: by the
    squares of their variances, steeper than the precision-weighted mean, since the errors of a model last and do not
    average out against those of a count. What contradicts the filter loses its weight.

        v_f = v_filter + S,  S' = S + a (1 - a) (f (d - m)^2 - S),  m' = m + a (d - m),  a = 1 - exp(-dt / wander_s)
        z_f = z_filter + p g V_z,  v_filter likewise with var(p g) V_z^2
        z_k = s_k - q (1 + p g),   v_k = v_s + var(p g) q^2 + gain^2 + offset^2     q charge drawn since the start
        d_k = z_f - z_k,           w_k = P(k at the start) t(d_k; 0, min(u_f + v_k, doubt_soc^2)),  w_0 = start_unknown
        z   = sum w_k (z_f - h_k d_k) / sum w_k,    h_k = u_f^2 / (u_f^2 + v_k^2)
        u_f = v_f + l^2 / (l + plateau_soc^2),      l = lasting error / slope^2: in a plateau the filter errs for long
        v   = sum w_k (v_f + h_k (v_k - v_f) + (z_f - h_k d_k - z)^2) / sum w_k

    Where filter and fusion disagree for long by more than both may err, sigma grows by as much; see `conflict_s`.

    Args:
        setup: the filter.
        state: after the update.
        motion: the step.
        measured: the sample.
        output: of the filter before the update.
        filter_v2: (n,) variance of the filter's SOC.
    """
    if motion.look_s > 0.0:
        lasting_soc_v2 = lasting_v2(setup, state, motion, measured) / slope_v2(setup, state, output)
        state = weigh(setup, state, motion, filter_v2, lasting_soc_v2)
    return state, state.fused_soc, np.minimum(state.fused_v2 * np.maximum(1.0, state.conflict), SOC_VARIANCE_MAX)


def weigh(setup: FilterSetup, state: State, motion: Motion, filter_v2: FloatArray, lasting_soc_v2: FloatArray) -> State:
    """Return the state with its starts weighed, and the filter fused with the count from each of them; see `fuse`."""
    tuning = setup.tuning
    state = wander(setup, state, motion)
    fused_gain, gain_v2 = believe_gain(setup, state)
    z = state.soc + state.gain_slope[0] * fused_gain
    filter_v2 = np.minimum(filter_v2 + state.gain_slope[0] ** 2 * gain_v2 + state.wander_v2, SOC_VARIANCE_MAX)
    count_v2 = state.start_v2 + gain_v2 * state.drawn**2 + state.count_gain**2 + state.count_offset**2
    d = z - (state.start_soc - state.drawn * (1.0 + fused_gain))
    errs_v2 = filter_v2 + lasting_soc_v2**2 / (lasting_soc_v2 + tuning.plateau_soc**2)
    errs_v2 = np.minimum(errs_v2, SOC_VARIANCE_MAX)
    w = state.start_weight * student(d, np.minimum(errs_v2 + count_v2, tuning.doubt_soc**2))
    share = errs_v2**2 / (errs_v2**2 + count_v2**2)
    total = tuning.start_unknown + w.sum(axis=0)
    moved = -(w * share * d).sum(axis=0) / total
    spread_v2 = (w * (share * d) ** 2).sum(axis=0) / total - moved**2
    within_v2 = filter_v2 + (w * share * (count_v2 - filter_v2)).sum(axis=0) / total
    fused_v2 = within_v2 + np.maximum(spread_v2, 0.0)
    beyond = moved**2 / (filter_v2 + fused_v2) - state.conflict
    return replace(
        state,
        fused_soc=z + moved,
        fused_v2=fused_v2,
        fused_gain=fused_gain,
        conflict=state.conflict + motion.look_share(tuning.conflict_s) * beyond,
    )


def wander(setup: FilterSetup, state: State, motion: Motion) -> State:
    """Return the state with the error that the filter does not know of.

    Within minutes a count cannot wander, whatever its start: what the filter moves against it is the filter's error.
    """
    a = motion.look_share(setup.tuning.wander_s)
    beyond = state.soc - state.count_soc - state.apart
    wander_v2 = state.wander_v2 + a * (1.0 - a) * (setup.tuning.wander_factor * beyond**2 - state.wander_v2)
    return replace(state, wander_v2=wander_v2, apart=state.apart + a * beyond)


def believe_gain(setup: FilterSetup, state: State) -> tuple[FloatArray, FloatArray]:
    """Return the (n,) gain that filter and counts go with, and its variance: the doubt about the cell file's capacity.

    p = P(gain is not 0 | filter),  odds against = (1 - prior) / prior sigma_0 / s exp(-g^2 / 2 s^2),  s^2 = doubt M
    """
    tuning, gain_v2 = setup.tuning, state.gain_v2
    s = np.maximum(np.sqrt(tuning.gain_doubt * gain_v2), 1e-6)
    odds = (1.0 - tuning.gain_prior) / tuning.gain_prior
    p = 1.0 / (1.0 + odds * tuning.gain_sigma / s * np.exp(-((state.gain / s) ** 2) / 2.0))
    return p * state.gain, p * gain_v2 + p * (1.0 - p) * state.gain**2


def watch_rest(state: State, motion: Motion, measured: Measurement) -> State:
    """Return the state with the moments of a regression of the voltage over time, in a rest from the start on."""
    off_v = np.where(measured.is_measured, measured.voltage_v - state.rest_mean_v, 0.0)
    return replace(
        state,
        rest_mean_v=state.rest_mean_v + motion.rest_share * off_v,
        rest_moment=state.rest_moment + motion.rest_lever * off_v,
    )


def read_rest(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> State:
    """Return the state after a rest from the start on: its voltage is a witness of the SOC given, and a hypothesis.

        a = tail b,   n^2 = 12 (tail noise)^2 dt / T^3     left to relax, if it goes on as its slope b = 12 moment / T^3
        f = p^2 / (p^2 + n^2),   p^2 = max(rest_left_v^2, a^2 - 4 n^2)     how much is no noise: 0..f a is left
        v = mean + b T / 2 + f a / 2,   s^2 = rest_v^2 + ocv^2 + f n^2 + (f a / 2)^2      ocv by hysteresis, temperature

    To believe a SOC that is wrong costs what it is off, to refuse one that is right what the reading errs: the exact
    one loses a share `rest_doubt_soc`^2 / (s_z^2 + `rest_doubt_soc`^2), s_z what s means in SOC.

    A rest that ends before it is `rest_s` long shows no relaxation, and is heard about a SOC that was given only: who
    gives none wakes up in a drive. One that goes on is heard for the moment, and again as a whole.
    """
    tuning, cell = setup.tuning, setup.cell
    given = state.start_weight[0] > 0.0
    heard = measured.is_measured & (given | motion.is_whole_rest)
    rested_s, unsure, rests = motion.read_rest_s, np.where(given, 1.0, 2.0), motion.is_whole_rest or motion.is_rest_on
    per_moment = 12.0 / rested_s**3
    noise_v2 = (tuning.rest_tail_s * tuning.rest_noise_v) ** 2 * per_moment * motion.dt_s
    slope = per_moment * state.rest_moment
    left_v = tuning.rest_tail_s * slope
    shown_v2 = left_v**2 - 4.0 * noise_v2 if rests else 0.0
    left_v2 = np.maximum((unsure * tuning.rest_left_v) ** 2, shown_v2)
    f = left_v2 / (left_v2 + noise_v2)
    half_v = f * left_v / 2.0
    rest_a = motion.current_a if rests else 0.0
    drop_v = state.resistance * cell.model.drop_per_c_v / cell.model.c_rate_a * rest_a
    rest_v = state.rest_mean_v + slope * rested_s / 2.0 + half_v + drop_v
    read = cell.soc_of_ocv(rest_v, measured.place)
    ocv_v2 = measured.doubt[OCV_ERROR] ** 2 + (tuning.lasting_hysteresis * cell.model.hysteresis_v) ** 2
    error_v = np.sqrt((unsure * tuning.rest_v) ** 2 + ocv_v2 + f * noise_v2 + half_v**2)
    v2 = cell.reading_sigma(read, error_v, measured.place) ** 2
    start_v2, d = state.start_v2[:-1], read + state.drawn - state.start_soc[:-1]
    total = start_v2 + v2
    soc = np.vstack((state.start_soc[:-1] + start_v2 / total * d, (read + state.drawn)[None]))
    variance = np.vstack((start_v2 * v2 / total, v2[None]))
    says_nothing = np.where(given, 1.0 - tuning.start_exact - tuning.start_rough, 1.0)
    believed = state.start_weight[:-1] * normal(d, total)
    believed[0] *= v2 / (v2 + tuning.rest_doubt_soc**2)
    weight = np.vstack((believed, says_nothing[None]))
    return replace(
        state,
        start_soc=np.where(heard, soc, state.start_soc),
        start_v2=np.where(heard, variance, state.start_v2),
        start_weight=np.where(heard, weight / weight.sum(axis=0), state.start_weight),
    )


def normal(d: FloatArray, v2: FloatArray) -> FloatArray:
    """Return the normal density of d with variance v2."""
    return np.asarray(np.exp(-(d**2) / v2 / 2.0) / np.sqrt(2.0 * math.pi * v2))


def student(d: FloatArray, v2: FloatArray) -> FloatArray:
    """Return Student's density of d with 31 degrees of freedom: tails a little heavier than normal."""
    return np.asarray(1.0 / ((1.0 + d**2 / (32.0 * v2)) ** 16 * np.sqrt(2.0 * math.pi * v2)))


def self_check(
    setup: FilterSetup, state: State, motion: Motion, measured: Measurement, nu: FloatArray, counts: BoolArray
) -> tuple[State, BoolArray]:
    """Return the state, and (n,) True while the model describes the cell.

        m' = m + (1 - exp(-dt / T)) (y - m)         of y = nu sqrt(r_0 / r), the innovation scaled to rest

    over `check_s` for y and y^2, over `bias_s` for y, and over `check_s` again for the square of that: an innovation
    that does not average out is an error that the filter takes for charge.

    Args:
        setup: the filter.
        state: after the fusion.
        motion: the step.
        measured: the sample.
        nu: (n,) innovations [V].
        counts: (n,) False where the sample is missing or was refused: it says nothing about the model.
    """
    tuning = setup.tuning
    y = np.where(counts, nu * tuning.model_error_v / np.sqrt(noise_v2(setup, motion, measured)), 0.0)
    share = np.where(counts, motion.share(tuning.check_s), 0.0)
    bias_share = np.where(counts, motion.share(tuning.bias_s), 0.0)
    after = replace(
        state,
        check_mean_v=state.check_mean_v + share * (y - state.check_mean_v),
        check_square_v2=state.check_square_v2 + share * (y**2 - state.check_square_v2),
        slow_mean_v=state.slow_mean_v + bias_share * (y - state.slow_mean_v),
        slow_square_v2=state.slow_square_v2 + share * (state.slow_mean_v**2 - state.slow_square_v2),
    )
    is_small = (after.check_square_v2 < tuning.check_rms_v**2) & (after.conflict < tuning.conflict_max)
    is_known = measured.doubt[DROP_ERROR] < tuning.drop_error_max
    return after, is_small & (np.abs(after.check_mean_v) < tuning.check_bias_v) & is_known
