"""Filter and charge count fused; the self-check that says whether the model describes the cell."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.filters.tables import LOWEST
from app.estimation.filters.tuning import Tuning
from tests.oracle.cells import sample, setup_of, state_at
from tests.oracle.engine import ReferenceEngine
from tests.oracle.fusion import fuse, read_rest, self_check, watch_rest, weigh_gain
from tests.oracle.output import Output
from tests.oracle.state import N_STARTS, motion_of, noise_v2

TUNING = Tuning()
SETUP = setup_of(tuning=TUNING)


def fused(state, dt_s, weighed_s, filter_v2, slope_v=1.0, lowest=0.0):
    """Return what `fuse` says of a filter with a variance, where the OCV has a slope."""
    one = np.ones(state.soc.size)
    output = Output(
        h=one, H=np.ones((1 + SETUP.cell.n_rc, state.soc.size)), bend_v2=0.0 * one, ocv_slope_v=slope_v * one
    )
    _, _, measured = sample(SETUP, state)
    uncertainty = measured.uncertainty.copy()
    uncertainty[LOWEST] = lowest
    measured = replace(measured, uncertainty=uncertainty)
    motion = motion_of(SETUP, dt_s, 0.0, since_s=weighed_s)
    return fuse(SETUP, state, motion, measured, output, filter_v2 * one)


class Pair:
    """A filter and a count that say different SOCs of one cell."""

    def __init__(self, filter_soc, count_soc, count_sigma=0.01):
        state = state_at(SETUP, filter_soc)
        self.state = replace(
            state,
            count_soc=np.array([count_soc]),
            start_soc=np.full((N_STARTS, 1), count_soc),
            start_v2=np.full((N_STARTS, 1), count_sigma**2),
            start_weight=np.array([[1.0], [0.0], [0.0], [0.0]]),
            apart=np.array([filter_soc - count_soc]),
        )

    def fuse(self, dt_s, filter_v2, filter_soc=None, lowest=0.0):
        if filter_soc is not None:
            self.state = replace(self.state, soc=np.array([filter_soc]))
        self.state, soc, variance = fused(self.state, dt_s, max(dt_s, 1.0), filter_v2, lowest=lowest)
        return soc[0], variance[0]


def test_estimates_as_sure_as_each_other_meet_halfway_and_are_no_surer_together():
    soc, variance = Pair(0.51, 0.50).fuse(0.1, 1e-4)
    assert soc == pytest.approx(0.505, abs=1e-3)
    assert variance == pytest.approx(1e-4, rel=0.05)


@pytest.mark.parametrize(("filter_sigma", "count_sigma", "nearer"), [(0.02, 0.01, 0.50), (0.01, 0.02, 0.51)])
def test_of_estimates_that_agree_the_surer_one_counts(filter_sigma, count_sigma, nearer):
    soc, variance = Pair(0.51, 0.50, count_sigma).fuse(0.1, filter_sigma**2)
    by_precision = (0.51 * count_sigma**2 + 0.50 * filter_sigma**2) / (count_sigma**2 + filter_sigma**2)
    assert abs(soc - nearer) < 0.5 * abs(by_precision - nearer)
    assert np.sqrt(variance) == pytest.approx(0.01, rel=0.1)


def test_a_filter_that_wanders_against_the_count_is_taken_for_less_sure_and_one_that_is_only_apart_is_not():
    swing, still = Pair(0.52, 0.50), Pair(0.52, 0.50)
    for k in range(1200):
        swung, _ = swing.fuse(1.0, 1e-4, 0.52 + 0.03 * np.sin(2 * np.pi * k / 200.0))
        stood, _ = still.fuse(1.0, 1e-4, 0.52)
    assert 0.03 / np.sqrt(2.0) < np.sqrt(swing.state.wander_v2[0]) < 2.0 * 0.03
    assert abs(swung - 0.50) < 0.005
    assert np.sqrt(still.state.wander_v2[0]) < 1e-3
    assert stood > 0.505


def test_what_a_filter_learns_in_a_long_gap_is_not_its_wander():
    pair = Pair(0.52, 0.50)
    pair.fuse(20.0 * 3600.0, 1e-2, 0.70)
    assert np.sqrt(pair.state.wander_v2[0]) < 1e-3
    assert pair.state.apart[0] == pytest.approx(0.20)


def test_where_the_lasting_error_is_worth_much_charge_the_count_goes_before_the_filter():
    state = Pair(0.52, 0.50).state
    _, steep, _ = fused(state, 0.1, 1.0, 1e-4, slope_v=1.0)
    _, flat, _ = fused(state, 0.1, 1.0, 1e-4, slope_v=0.05)
    assert abs(flat[0] - 0.50) < 0.2 * abs(steep[0] - 0.50)


def test_a_count_that_is_contradicted_does_not_count():
    soc, variance = Pair(0.90, 0.40).fuse(0.1, 4e-4)
    assert soc == pytest.approx(0.90, abs=1e-4)
    assert variance == pytest.approx(4e-4, rel=0.01)


@pytest.mark.parametrize("filter_sigma", [0.10, 0.15])
def test_a_start_half_of_the_range_off_is_not_believed_by_a_filter_that_knows_little_either(filter_sigma):
    soc, _ = Pair(0.60, 0.15, 0.007).fuse(0.1, filter_sigma**2)
    assert soc == pytest.approx(0.60, abs=0.001)


def test_between_agreement_and_contradiction_sigma_covers_both():
    for gap in np.linspace(0.0, 0.2, 81):
        soc, variance = Pair(0.60, 0.60 - gap).fuse(0.0, 4e-4)
        assert variance > 0.0
        assert 0.6 - gap - 1e-12 <= soc <= 0.6 + 1e-12


@pytest.mark.parametrize(("own_sigma", "trusts_filter"), [(0.1, True), (0.01, False)])
def test_what_a_filter_moves_within_its_covariance_while_it_settles_is_no_wander(own_sigma, trusts_filter):
    pair = Pair(0.52, 0.50)
    pair.state = replace(pair.state, apart_v2=np.array([own_sigma**2]))
    for _ in range(30):
        soc, _ = pair.fuse(1.0, 1e-4, filter_soc=0.60)
    assert (soc > 0.59) == trusts_filter


def test_a_start_that_was_contradicted_for_minutes_does_not_return_where_the_filter_knows_little():
    pair = Pair(0.62, 0.50)
    pair.fuse(1.0, 1e-4)
    before = pair.state
    soc_before, _ = pair.fuse(1.0, 0.05**2)
    pair.state = before
    for _ in range(180):
        pair.fuse(1.0, 1e-4)
    soc, _ = pair.fuse(1.0, 0.05**2)
    assert soc_before < 0.55
    assert soc > 0.60
    agreeing = Pair(0.51, 0.50)
    for _ in range(180):
        agreeing.fuse(1.0, 1e-4)
    assert agreeing.state.start_weight[0, 0] == 1.0


@pytest.mark.parametrize("start_weight", [(0.0, 0.0), (0.0, 1.0)])
@pytest.mark.parametrize(("lowest", "expected"), [(0.55, 0.55), (0.45, 0.49)])
def test_below_what_the_file_has_seen_it_is_counted_on_from_where_the_filter_was_the_surest(
    start_weight, lowest, expected
):
    pair = Pair(0.60, 0.50, count_sigma=0.1)
    weight = np.array([[start_weight[0]], [start_weight[1]], [0.0], [0.0]])
    pair.state = replace(pair.state, start_weight=weight)
    pair.fuse(1.0, 0.01**2)
    pair.state = replace(pair.state, drawn=np.array([0.05]), count_soc=np.array([0.45]))
    soc, variance = pair.fuse(1.0, 0.10**2, filter_soc=0.50, lowest=lowest)
    assert soc == pytest.approx(expected, abs=0.02)
    assert (np.sqrt(variance) < 0.06) == (lowest > 0.50)
    pair.fuse(1.0, 0.005**2)
    assert pair.state.best_soc[0] == pytest.approx(0.55), "surer now than ever"


def test_between_two_looks_nothing_is_weighed():
    pair = Pair(0.51, 0.50)
    before, _ = pair.fuse(1.0, 1e-4)
    state = replace(pair.state, soc=np.array([0.9]))
    _, soc, _ = fused(state, 0.1, 0.0, 1e-6)
    assert soc[0] == before


def test_a_disagreement_beyond_both_errors_widens_sigma_and_clears_the_verdict():
    pair = Pair(0.60, 0.50, 0.003)
    for _ in range(600):
        _, variance = pair.fuse(1.0, 0.02**2)
        pair.state = replace(pair.state, start_weight=np.array([[1e9], [0.0], [0.0], [0.0]]))
    assert variance > 4.0 * pair.state.fused_v2[0]
    state = replace(pair.state, conflict=np.array([TUNING.gate**2 + 1.0]))
    state, motion, measured = sample(SETUP, state)
    _, valid = self_check(SETUP, state, motion, measured, np.zeros(1), np.array([True]), np.full(1, 0.5))
    assert not valid[0]


def gain_believed(gain, sigma):
    state = replace(state_at(SETUP, 0.5), gain=np.array([gain]), gain_v2=np.array([sigma**2]))
    believed, variance = weigh_gain(SETUP, state)
    return believed[0], variance[0]


def test_a_small_gain_is_left_to_the_cell_file_and_a_large_one_is_believed():
    assert abs(gain_believed(0.01, 0.01)[0]) < 0.25 * 0.01
    assert gain_believed(0.10, 0.01)[0] == pytest.approx(0.10, rel=0.01)
    assert gain_believed(0.0, TUNING.gain_sigma)[0] == 0.0


def rested(given=None, sigma=0.003, soc=0.6, lasted_s=TUNING.rest_s, rises_v=0.0, then_a=0.0):
    """Return the hypotheses after a rest in which the voltage rose by `rises_v` to the OCV of `soc`."""
    volts = SETUP.cell.ocv(np.array([soc]))
    state, _, measured = sample(SETUP, state_at(SETUP, soc), volts)
    state = replace(state, rest_mean_v=volts)
    if given is not None:
        state = replace(
            state,
            start_soc=np.array([[given], [given], [soc], [soc]]),
            start_v2=np.array([[sigma**2], [TUNING.rough_soc**2], [0.25], [0.25]]),
            start_weight=np.array([[TUNING.start_exact], [TUNING.start_rough], [0.0], [0.0]]),
        )
    else:
        state = replace(state, start_v2=np.full((N_STARTS, 1), 0.25), start_weight=np.zeros((N_STARTS, 1)))
    for k in range(round(lasted_s / 0.1)):
        share = (k + 1) / round(lasted_s / 0.1)
        _, _, measured = sample(SETUP, state, volts - rises_v * (1.0 - share))
        motion = motion_of(SETUP, 0.1, 0.0, rest_s=0.1 * k)
        state = watch_rest(SETUP, state, motion, measured)
    motion = motion_of(SETUP, 0.1, then_a, rest_s=lasted_s)
    return read_rest(SETUP, state, motion, measured) if motion.read_rest_s > 0.0 else state


def test_a_rest_confirms_a_start_that_is_right_and_refuses_one_that_is_far_off():
    assert rested(0.6).start_weight[0] > 0.4
    wrong = rested(0.1)
    assert wrong.start_weight[2:].sum() > 0.99
    assert wrong.start_soc[2] == pytest.approx(0.6, abs=1e-3)


def test_a_start_some_points_off_is_rather_roughly_right():
    off = rested(0.52)
    assert off.start_weight[0] < 0.1
    assert (off.start_weight * off.start_soc).sum() == pytest.approx(0.6, abs=0.02)


def test_a_rest_that_ends_early_is_heard_about_a_start_that_was_given_and_says_nothing_of_a_drive():
    short = {"lasted_s": 4.0, "then_a": 50.0}
    assert rested(0.52, **short).start_weight[0] < 0.1
    assert not rested(**short).start_weight.any()
    assert rested(0.6, lasted_s=1.0, then_a=50.0).start_weight[2] == 0.0


def test_a_voltage_that_still_rises_is_read_higher_and_with_more_uncertainty():
    still, rising = rested(), rested(rises_v=0.004)
    assert rising.start_soc[2] > still.start_soc[2] + 0.005
    assert rising.start_v2[2] > still.start_v2[2]


def test_the_noise_of_a_sensor_is_no_relaxation():
    assert rested(lasted_s=4.0, rises_v=0.0006, soc=0.6).start_weight[2] == 0.0
    short = rested(0.6, lasted_s=4.0, rises_v=0.0006, then_a=50.0)
    assert short.start_soc[2] == pytest.approx(0.6, abs=0.003)


def test_a_rest_of_a_cell_that_nobody_knew_is_read_with_more_uncertainty():
    unknown = rested()
    assert unknown.start_weight[:2, 0].tolist() == [0.0, 0.0]
    assert unknown.start_weight[2:].sum() == pytest.approx(1.0)
    assert unknown.start_v2[2] > rested(0.6).start_v2[2]


REST_V2 = TUNING.model_error_v**2


def judged(innovations, current_a=0.0, counts=True):
    """Return the state after innovations one second apart, and the verdict after each."""
    state = state_at(SETUP, 0.5)
    valid = []
    for y in innovations:
        state, motion, measured = sample(SETUP, state, current_a=current_a)
        state, ok = self_check(SETUP, state, motion, measured, np.array([y]), np.array([counts]), np.full(1, 0.5))
        valid.append(bool(ok[0]))
    return state, valid


def test_a_model_that_fits_stays_valid():
    _, valid = judged(np.random.default_rng(1).normal(0.0, 0.01, 2000))
    assert all(valid)


def test_a_bias_above_the_limit_invalidates_after_its_time_and_not_at_once():
    _, valid = judged(np.full(900, 1.5 * TUNING.check_bias_v))
    assert valid[10]
    assert not valid[-1]


def test_noise_above_the_limit_invalidates_and_a_model_that_recovers_is_valid_again():
    _, valid = judged(np.concatenate((np.tile([0.08, -0.08], 300), np.zeros(900))))
    assert not valid[599]
    assert valid[-1]


def test_the_limits_stand_for_rest_and_grow_with_the_expected_error():
    def error_v2(current_a):
        _, motion, measured = sample(SETUP, state_at(SETUP, 0.5), current_a=current_a)
        return noise_v2(SETUP, motion, measured)[0]

    current_a = next(i for i in range(0, 2000, 5) if error_v2(float(i)) > 9.0 * REST_V2)
    _, valid = judged(np.full(900, 1.5 * TUNING.check_bias_v), float(current_a))
    assert valid[-1]


def test_what_averages_out_is_no_lasting_error_and_what_stays_is():
    fast, _ = judged(np.tile([0.02, -0.02], 1000))
    slow, _ = judged(np.full(2000, 0.02))
    assert fast.slow_square_v2[0] < 0.01 * 0.02**2
    assert slow.slow_square_v2[0] == pytest.approx(0.02**2, rel=0.01)


def test_samples_that_do_not_count_move_nothing():
    state, valid = judged(np.full(50, 1.0), counts=False)
    assert state.check_mean_v[0] == state.check_square_v2[0] == state.slow_mean_v[0] == 0.0
    assert all(valid)


def test_a_rest_that_goes_on_is_heard_within_a_second_and_not_kept():
    engine = ReferenceEngine(SETUP, 1)
    volts, degc = SETUP.cell.model.ocv.voltage(np.array([0.6])), np.full(1, 25.0)
    engine.start(0.0, volts, degc, np.array([0.52]), np.array([np.nan]))
    starts = engine.get("start_soc")
    soc, sigma = engine.step(TUNING.weighing_s, 0.0, volts, degc)[:2]
    assert abs(soc - 0.6) < min(0.01, 3.0 * sigma)
    np.testing.assert_array_equal(engine.get("start_soc"), starts)


def mixed(state):
    """Return mean and sigma of the SOC over the hypotheses of the start."""
    w, soc, v2 = (getattr(state, name)[:, 0] for name in ("start_weight", "start_soc", "start_v2"))
    mean = (w * soc).sum()
    return mean, np.sqrt((w * (v2 + (soc - mean) ** 2)).sum())


@pytest.mark.parametrize("lasted_s", [3.0, 9.0, TUNING.rest_s])
def test_a_pause_of_a_drive_that_still_relaxes_does_not_refute_a_start_that_is_right(lasted_s):
    volts = SETUP.cell.ocv(np.array([0.6]))[0] - 0.03  # as far as it has relaxed at the end of the pause
    low = float(SETUP.cell.soc_of_ocv(np.array([volts]))[0])
    soc, sigma = mixed(rested(0.6, soc=low, lasted_s=lasted_s, rises_v=5e-4 * lasted_s, then_a=50.0))
    assert abs(soc - 0.6) < min(0.6 - low, 3.0 * sigma)


def test_a_relaxation_beyond_all_bounds_leaves_probabilities():
    for rises_v in (-1.0, 1.0, 2.0):
        state = rested(0.6, rises_v=rises_v)
        assert np.isfinite(state.start_soc).all()
        assert (state.start_v2 > 0.0).all()
        assert state.start_weight.sum() == pytest.approx(1.0)


def test_a_small_current_that_rises_in_a_rest_is_no_relaxation():
    model = SETUP.cell.model
    volts = model.ocv.voltage(np.array([0.6]))
    drop_ohm = model.drop_per_c_v / model.c_rate_a
    for end_a in (0.0, 0.9 * TUNING.rest_c * model.capacity_ah):
        state, _, _ = sample(SETUP, state_at(SETUP, 0.6), volts)
        for k in range(100):
            current_a = end_a * k / 100.0
            _, motion, measured = sample(SETUP, state, volts - drop_ohm * current_a, current_a=current_a)
            motion = motion_of(SETUP, 0.1, current_a, rest_s=0.1 * k)
            state = watch_rest(SETUP, state, motion, measured)
        assert state.rest_mean_v[0] == pytest.approx(volts[0], abs=1e-9)
        assert state.rest_moment[0] == pytest.approx(0.0, abs=1e-6)
