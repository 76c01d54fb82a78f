"""What is reported: sigma, fusion with the charge count, self-check."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.filters.setup import FilterSetup
from app.estimation.filters.tables import DROP_ERROR, LASTING_DROP, LASTING_S, LOWEST, OCV_ERROR
from tests.oracle.output import Output
from tests.oracle.state import (
    LEAST_VARIANCE,
    N_GIVEN,
    N_STARTS,
    SLOPE_FLOOR_V,
    SOC_VARIANCE_MAX,
    Measurement,
    Motion,
    State,
    lasting_v2,
    noise_v2,
)

ROUGH: Final = 1  # the hypothesis of a SOC that is roughly right
CONTRADICTION: Final = 3.0  # d^2 / 2 v, 2.4 sigma, from which a start is less likely than any other SOC


def soc_variance(setup: FilterSetup, state: State, measured: Measurement, output: Output) -> FloatArray:
    """Return (n,) variance of the filter's SOC with the error that averaging does not remove.

    v_f = P_zz + mean square of the lasting innovation / slope^2 + max(lowest - z, 0)^2: a model that errs is
    trusted less, and below the lowest SOC that the cell file has seen it only shows that it is below. The slope is that
    of the sigma points or, if less, of a voltage that is read: in a plateau's step neither may be local.
    """
    below = np.maximum(measured.uncertainty[LOWEST] - state.soc, 0.0)
    error_v2 = state.slow_square_v2 / slope_v2(setup, state, output)
    variance = state.cov[0, 0] + error_v2 + below**2
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
        d_k = z_f - z_k
        w_k = P(k at the start) t(d_k; 0, min(u_f + v_k, apart_soc_max^2)),  w_0 = start_unknown
        z   = sum w_k (z_f - h_k d_k) / sum w_k,    h_k = u_f^2 / (u_f^2 + v_k^2)
        u_f = v_f - min(f e, S) + l^2 / (l + plateau_soc^2),   l = lasting error / slope^2, large in a plateau
        e   = max(P_m - P_zz, 0),  P_m' = P_m + a (P_zz - P_m)     what the filter moved within its own covariance
        z_b = z_f when u_f was least, counted on, below the lowest SOC that the cell file has seen: in place of z_k
        where no start is right, and for a rough one that is less sure, h_b = u_f^4 / (u_f^4 + v_b^4); v_b: see
        `remember_best`
        P'  = P / (1 + a max(d_k^2 / 2 v - 3, 0))                  v as in w_k: what was contradicted stays so
        v   = sum w_k (v_f + h_k (v_k - v_f) + (z_f - h_k d_k - z)^2) / sum w_k

    Where no SOC was given and the voltage of a rest at the start still relaxes, filter and count read the same voltage,
    and are off by the same u, which decays within `rest_lasts_s`: v grows by u^2 / slope^2. Under current both learn
    otherwise: a rest that is not whole leaves no u.

    Where filter and fusion disagree for long by more than both may err, sigma grows by as much; see `conflict_s`.

    Args:
        setup: the filter.
        state: after the update.
        motion: the step.
        measured: the sample.
        output: of the filter before the update.
        filter_v2: (n,) variance of the filter's SOC.
    """
    if motion.weighed_s > 0.0:
        lasting_soc_v2 = lasting_v2(setup, state, motion, measured) / slope_v2(setup, state, output)
        left_v2 = state.unsettled_v2 * (1.0 - motion.weighed_share(LASTING_S / 2.0))
        is_below = state.soc < measured.uncertainty[LOWEST]
        state = weigh(setup, replace(state, unsettled_v2=left_v2), motion, filter_v2, lasting_soc_v2, is_below)
        # what has not settled is off in both, so neither is the surer one for it
        state = replace(state, fused_v2=state.fused_v2 + left_v2 / slope_v2(setup, state, output))
    return state, state.fused_soc, np.minimum(state.fused_v2 * np.maximum(1.0, state.conflict), SOC_VARIANCE_MAX)


def weigh(
    setup: FilterSetup,
    state: State,
    motion: Motion,
    filter_v2: FloatArray,
    lasting_soc_v2: FloatArray,
    is_below: BoolArray,
) -> State:
    """Return the state with its starts weighed, and the filter fused with the count from each of them; see `fuse`."""
    tuning = setup.tuning
    state = wander(setup, state, motion)
    fused_gain, gain_v2 = weigh_gain(setup, state)
    z = state.soc + state.gain_slope[0] * fused_gain
    alone_v2 = filter_v2 + state.gain_slope[0] ** 2 * gain_v2
    filter_v2 = np.minimum(alone_v2 + state.wander_v2, SOC_VARIANCE_MAX)
    count_v2 = state.start_v2 + gain_v2 * state.drawn**2 + state.count_gain**2 + state.count_offset**2
    d = z - (state.start_soc - state.drawn * (1.0 + fused_gain))
    known_v2 = tuning.hidden_factor * np.maximum(state.apart_v2 - state.cov[0, 0], 0.0)
    strays_v2 = np.maximum(state.wander_v2 - known_v2, 0.0)
    now_v2 = alone_v2 + lasting_soc_v2**2 / (lasting_soc_v2 + tuning.rough_soc**2)
    errs_v2 = np.minimum(now_v2 + strays_v2, SOC_VARIANCE_MAX)
    total_v2 = np.minimum(errs_v2 + count_v2, tuning.apart_soc_max**2)
    w = state.start_weight * student(d, total_v2)
    contradicted = np.maximum(d**2 / total_v2 / 2.0 - CONTRADICTION, 0.0)
    variances = np.minimum(now_v2, SOC_VARIANCE_MAX), strays_v2, errs_v2
    state, off, best_v2 = remember_best(setup, state, z, variances, fused_gain, gain_v2)
    is_less_sure = is_below & (best_v2 < count_v2)
    is_less_sure[np.arange(N_STARTS) != ROUGH] = False
    sure_v2, apart = np.where(is_less_sure, best_v2, count_v2), np.where(is_less_sure, off, d)
    kept = np.where(is_below, errs_v2**4 / (errs_v2**4 + best_v2**4), 0.0)
    share = np.where(is_less_sure, kept, errs_v2**2 / (errs_v2**2 + count_v2**2))
    unknown, total = tuning.start_unknown, tuning.start_unknown + w.sum(axis=0)
    moved = -(unknown * kept * off + (w * share * apart).sum(axis=0)) / total
    spread_v2 = (unknown * (kept * off) ** 2 + (w * (share * apart) ** 2).sum(axis=0)) / total - moved**2
    within_v2 = unknown * kept * (np.minimum(best_v2, filter_v2) - filter_v2)
    within_v2 = filter_v2 + (within_v2 + (w * share * (sure_v2 - filter_v2)).sum(axis=0)) / total
    fused_v2 = within_v2 + np.maximum(spread_v2, 0.0)
    beyond = moved**2 / (filter_v2 + fused_v2) - state.conflict
    return replace(
        state,
        fused_soc=z + moved,
        fused_v2=fused_v2,
        fused_gain=fused_gain,
        start_weight=state.start_weight / (1.0 + motion.weighed_share(tuning.wander_s) * contradicted),
        conflict=state.conflict + motion.weighed_share(tuning.check_s) * beyond,
    )


def remember_best(
    setup: FilterSetup,
    state: State,
    z: FloatArray,
    variances: tuple[FloatArray, FloatArray, FloatArray],
    fused_gain: FloatArray,
    gain_v2: FloatArray,
) -> tuple[State, FloatArray, FloatArray]:
    """Return the state, how far the filter is from where it was the surest, counted on, and the variance of that.

    What the filter strays now it strayed then: of the `variances` without it, of it, and with it, the first is kept.
    """
    now_v2, strays_v2, errs_v2 = variances
    counted, since = state.drawn * (1.0 + fused_gain), state.drawn - state.best_drawn
    since_v2 = (gain_v2 + setup.tuning.counter_gain**2) * since**2 + (state.count_offset - state.best_offset) ** 2
    aged_v2 = state.best_v2 + strays_v2 + since_v2
    is_best = errs_v2 <= aged_v2
    state = replace(
        state,
        best_soc=np.where(is_best, z + counted, state.best_soc),
        best_v2=np.where(is_best, now_v2, state.best_v2),
        best_drawn=np.where(is_best, state.drawn, state.best_drawn),
        best_offset=np.where(is_best, state.count_offset, state.best_offset),
    )
    kept_v2, off = np.minimum(errs_v2, aged_v2), z - (state.best_soc - counted)
    return state, off, kept_v2 * (1.0 + (off**2 / (9.0 * (errs_v2 + kept_v2))) ** 2)


def wander(setup: FilterSetup, state: State, motion: Motion) -> State:
    """Return the state with the error that the filter does not know of.

    Within minutes a count cannot wander, whatever its start: what the filter moves against it is the filter's error.
    """
    a = motion.weighed_share(setup.tuning.wander_s)
    beyond = state.soc - state.count_soc - state.apart
    wander_v2 = state.wander_v2 + a * (1.0 - a) * (setup.tuning.hidden_factor * beyond**2 - state.wander_v2)
    apart_v2 = state.apart_v2 + a * (state.cov[0, 0] - state.apart_v2)
    return replace(state, wander_v2=wander_v2, apart=state.apart + a * beyond, apart_v2=apart_v2)


def weigh_gain(setup: FilterSetup, state: State) -> tuple[FloatArray, FloatArray]:
    """Return the (n,) gain that filter and counts use, and its variance: the uncertainty of the cell file's capacity.

    p = P(gain is not 0 | filter),  odds against = (1 - prior) / prior sigma_0 / s exp(-g^2 / 2 s^2),  s^2 = u M,
    u = gain_uncertainty
    """
    tuning, gain_v2 = setup.tuning, state.gain_v2
    s = np.maximum(np.sqrt(tuning.hidden_factor * gain_v2), 1e-6)
    p = 1.0 / (1.0 + tuning.gain_sigma / s * np.exp(-((state.gain / s) ** 2) / 2.0))
    return p * state.gain, p * gain_v2 + p * (1.0 - p) * state.gain**2


def watch_rest(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> State:
    """Return the state with the moments of a regression of the voltage over time, in a rest from the start on.

    What a small current drops is no relaxation.
    """
    model = setup.cell.model
    now_v = measured.voltage_v + state.resistance * (model.drop_per_c_v / model.c_rate_a * motion.current_a)
    off_v = np.where(measured.is_measured, now_v - state.rest_mean_v, 0.0)
    return replace(
        state,
        rest_mean_v=state.rest_mean_v + motion.rest_share * off_v,
        rest_moment=state.rest_moment + motion.rest_lever * off_v,
    )


def read_rest_voltage(
    setup: FilterSetup, state: State, motion: Motion, measured: Measurement, given: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (2, n) SOC, variance and weight of a rest's voltage: of a settled cell, and of one that relaxes.

        a = tail b,   n^2 = 12 (tail noise)^2 dt / T^3     left to relax, if it goes on as its slope b = 12 moment / T^3
        p^2 = rest_left_v^2 or (rho ohm rest_driven_c)^2   what there may be: settled, or after so much current
        weight = P N(a; 0, p^2 + n^2)
        f = p^2 / (p^2 + n^2),   v = mean + b T / 2 + f a / 2     how much of it is no noise: 0..f a is left
        s^2 = rest_v^2 + ocv^2 + f n^2 + (f a / 2)^2 [+ (rest_slow p)^2, relaxing too slowly to be seen]

    ocv by hysteresis and temperature; who gave no SOC rather wakes up in a drive: rest_v and rest_left_v count twice.
    """
    tuning, cell = setup.tuning, setup.cell
    rested_s, unsure = motion.read_rest_s, np.where(given, 1.0, 2.0)
    per_moment = 12.0 / rested_s**3
    noise_v2 = (tuning.rest_tail_s * tuning.rest_noise_v) ** 2 * per_moment * motion.dt_s
    slope = per_moment * state.rest_moment
    left_v = tuning.rest_tail_s * slope
    settled_v2 = (unsure * tuning.rest_left_v) ** 2
    driven_a = tuning.driven_c * cell.model.capacity_ah
    driven_v2 = np.maximum((state.resistance * measured.uncertainty[LASTING_DROP] * driven_a) ** 2, settled_v2)
    left_v2 = np.array((settled_v2, driven_v2))
    slow_v2 = np.array((np.zeros_like(driven_v2), tuning.rest_slow**2 * driven_v2))
    settled_total, driven_total = left_v2 + noise_v2
    odds = tuning.rest_settled / (1.0 - tuning.rest_settled) * np.sqrt(driven_total / settled_total)
    odds = odds * np.exp(left_v**2 / 2.0 * (1.0 / driven_total - 1.0 / settled_total))
    f = left_v2 / (left_v2 + noise_v2)
    half_v = f * left_v / 2.0
    rest_v = state.rest_mean_v + slope * rested_s / 2.0 + half_v
    ocv_v2 = measured.uncertainty[OCV_ERROR] ** 2 + cell.model.hysteresis_v**2 / 3.0
    error_v = np.sqrt((unsure * tuning.rest_v) ** 2 + ocv_v2 + f * noise_v2 + half_v**2 + slow_v2)
    read = np.array([cell.soc_of_ocv(each, measured.place) for each in rest_v])
    v2 = np.array([cell.reading_sigma(*each, measured.place) ** 2 for each in zip(read, error_v, strict=True)])
    return read + state.drawn, v2, np.array((odds, np.ones_like(odds))) / (1.0 + odds)


def unsettled_v2(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> FloatArray:
    """Return (n,) mean square by which a voltage may be off that is seen to relax [V^2].

    u^2 = min(rest_unsettled^2 max(a^2 - (3 n)^2, 0), (2 p)^2),  a, n and the p of a cell that was driven as in
    `read_rest_voltage`
    """
    tuning, per_moment = setup.tuning, 12.0 / motion.read_rest_s**3
    noise_v2 = (tuning.rest_tail_s * tuning.rest_noise_v) ** 2 * per_moment * motion.dt_s
    seen_v2 = np.maximum((tuning.rest_tail_s * per_moment * state.rest_moment) ** 2 - 9.0 * noise_v2, 0.0)
    driven_a = tuning.driven_c * setup.cell.model.capacity_ah
    driven_v2 = (state.resistance * measured.uncertainty[LASTING_DROP] * driven_a) ** 2
    return np.asarray(np.minimum(tuning.rest_unsettled**2 * seen_v2, 4.0 * driven_v2))


def read_rest(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> State:
    """Return the state after a rest from the start on: its voltage is a witness of the SOC given, and a hypothesis.

    What is given is held against both readings of `read_rest_voltage`, which are two hypotheses more. To believe a
    wrong SOC costs what it is off, to refuse a right one what the reading errs: the exact one loses a share
    `rest_uncertainty_soc`^2 / (s_z^2 + `rest_uncertainty_soc`^2), s_z what s means in SOC.

    A rest that ends before it is `rest_s` long is heard about a SOC that was given only: who gives none wakes up in a
    drive. One that goes on is heard for the moment, and again as a whole.
    """
    tuning = setup.tuning
    given = state.start_weight[0] > 0.0
    heard = measured.is_measured & (given | motion.is_whole_rest)
    read, v2, likely = read_rest_voltage(setup, state, motion, measured, given)
    start_v2, d = state.start_v2[:N_GIVEN, None], read - state.start_soc[:N_GIVEN, None]
    total = start_v2 + v2  # (given, readings, n)
    believed = state.start_weight[:N_GIVEN, None] * likely * normal(d, total)
    believed[0] *= v2 / (v2 + tuning.rest_uncertainty_soc**2)
    says_nothing = np.where(given, 1.0 - tuning.start_exact - tuning.start_rough, 1.0)
    weight = np.vstack((believed.sum(axis=1), likely * says_nothing))
    each_soc = state.start_soc[:N_GIVEN, None] + start_v2 / total * d
    each_v2 = start_v2 * v2 / total
    sure = np.where(weight[:N_GIVEN] > 0.0, weight[:N_GIVEN], 1.0)
    mean = (believed * each_soc).sum(axis=1) / sure
    variance = (believed * (each_v2 + each_soc**2)).sum(axis=1) / sure - mean**2
    soc = np.vstack((np.where(weight[:N_GIVEN] > 0.0, mean, state.start_soc[:N_GIVEN]), read))
    kept_v2 = np.where(weight[:N_GIVEN] > 0.0, np.maximum(variance, LEAST_VARIANCE), state.start_v2[:N_GIVEN])
    return replace(
        state,
        start_soc=np.where(heard, soc, state.start_soc),
        start_v2=np.where(heard, np.vstack((kept_v2, v2)), state.start_v2),
        start_weight=np.where(heard, weight / weight.sum(axis=0), state.start_weight),
        unsettled_v2=np.where(
            measured.is_measured & ~given, unsettled_v2(setup, state, motion, measured), state.unsettled_v2
        ),
    )


def normal(d: FloatArray, v2: FloatArray) -> FloatArray:
    """Return the normal density of d with variance v2."""
    return np.asarray(np.exp(-(d**2) / v2 / 2.0) / np.sqrt(2.0 * math.pi * v2))


def student(d: FloatArray, v2: FloatArray) -> FloatArray:
    """Return Student's density of d with 31 degrees of freedom: tails a little heavier than normal."""
    return np.asarray(1.0 / ((1.0 + d**2 / (32.0 * v2)) ** 16 * np.sqrt(2.0 * math.pi * v2)))


def self_check(
    setup: FilterSetup,
    state: State,
    motion: Motion,
    measured: Measurement,
    nu: FloatArray,
    counts: BoolArray,
    soc: FloatArray,
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
        soc: (n,) what is reported.
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
    is_small = (after.check_square_v2 < tuning.check_rms_v**2) & (after.conflict < tuning.gate**2)
    is_near = (measured.uncertainty[DROP_ERROR] < tuning.drop_error_max) & (soc >= measured.uncertainty[LOWEST])
    is_known = is_near & (abs(motion.current_a) <= setup.cell.seen_a)
    return after, is_small & (np.abs(after.check_mean_v) < tuning.check_bias_v) & is_known
