"""Filter and charge count fused; the self-check that says whether the model describes the cell."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.filters.reference.fusion import fuse, self_check
from app.estimation.filters.reference.state import motion_of
from app.estimation.filters.tuning import Tuning
from tests.unit.app.estimation.filters.reference.cells import setup_of, state_at

TUNING = Tuning(anchor_s=60.0)
SETUP = setup_of(tuning=TUNING)


class Pair:
    """A filter and a count that say different SOCs of one cell."""

    def __init__(self, filter_soc, count_soc, count_sigma=0.01):
        state = state_at(SETUP, filter_soc)
        self.state = replace(
            state,
            count_soc=np.array([count_soc]),
            anchor_v2=np.array([count_sigma**2]),
            apart=np.array([filter_soc - count_soc]),
        )

    def fuse(self, dt_s, filter_v2, filter_soc=None):
        if filter_soc is not None:
            self.state = replace(self.state, soc=np.array([filter_soc]))
        self.state, soc, variance = fuse(SETUP, self.state, motion_of(SETUP, dt_s, 0.0), np.array([filter_v2]))
        return soc[0], variance[0]


def test_estimates_as_sure_as_each_other_meet_halfway_and_are_no_surer_together():
    soc, variance = Pair(0.51, 0.50).fuse(0.1, 1e-4)
    assert soc == pytest.approx(0.505, abs=5e-4)
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


def test_a_count_contradicted_without_a_break_is_anchored_anew():
    pair = Pair(0.90, 0.40)
    for _ in range(61):
        pair.fuse(1.0, 4e-4)
    assert pair.state.count_soc[0] == 0.90
    assert pair.state.count_v2[0] > 4e-4
    soc, _ = pair.fuse(1.0, 1e-4, 0.92)
    assert soc == pytest.approx(0.92, abs=0.002), "a filter that has become surer leads"
    pair = Pair(0.90, 0.40)
    for k in range(200):
        pair.fuse(1.0, 4e-4, 0.40 if k % 50 == 49 else 0.90)
    assert pair.state.count_soc[0] == 0.40


REST_V2 = TUNING.voltage_variance(0.0)


def judged(innovations, current_a=0.0, counts=True):
    """Return the state after innovations one second apart, and the verdict after each."""
    state = state_at(SETUP, 0.5)
    valid = []
    for y in innovations:
        state, ok = self_check(SETUP, state, motion_of(SETUP, 1.0, current_a), np.array([y]), np.array([counts]))
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
    current_a = next(i for i in range(0, 2000, 5) if motion_of(SETUP, 1.0, float(i)).noise_v2 > 9.0 * REST_V2)
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
