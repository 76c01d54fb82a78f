import numpy as np
import pytest

from app.estimation.filters.self_check import SelfCheck
from app.estimation.filters.states import CellStates
from app.estimation.filters.tuning import Tuning

TUNING = Tuning()
REST_V2 = TUNING.voltage_variance(0.0)
DT_S = 1.0


def judged(innovations, noise_v2=REST_V2, counts=None):
    states = CellStates(2, 1)
    check = SelfCheck(states, TUNING)
    valid = [check.update(DT_S, np.array([y]), noise_v2, counts)[0] for y in innovations]
    return states, valid


def test_a_model_that_fits_stays_valid():
    _, valid = judged(np.random.default_rng(1).normal(0.0, 0.01, 2000))
    assert all(valid)


def test_a_bias_above_the_limit_invalidates_after_its_time_and_not_at_once():
    _, valid = judged(np.full(900, 1.5 * TUNING.check_bias_v))
    assert valid[10]
    assert not valid[-1]


def test_noise_above_the_limit_invalidates_and_a_model_that_recovers_is_valid_again():
    y = np.concatenate((np.tile([0.08, -0.08], 300), np.zeros(900)))
    _, valid = judged(y)
    assert not valid[599]
    assert valid[-1]


def test_the_limits_stand_for_rest_and_grow_with_the_expected_error():
    _, valid = judged(np.full(900, 1.5 * TUNING.check_bias_v), noise_v2=9.0 * REST_V2)
    assert valid[-1]


def test_what_averages_out_is_no_lasting_error_and_what_stays_is():
    fast, _ = judged(np.tile([0.02, -0.02], 1000))
    slow, _ = judged(np.full(2000, 0.02))
    assert fast.bias_v2[0] < 0.01 * 0.02**2
    assert slow.bias_v2[0] == pytest.approx(0.02**2, rel=0.01)


def test_samples_that_do_not_count_move_nothing():
    states, _ = judged(np.full(50, 1.0), counts=np.array([False]))
    assert not states.averages.any()
    assert states.bias_v2[0] == 0.0
