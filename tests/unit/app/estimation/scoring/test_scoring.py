import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.scoring import score_soc, settling_time


def test_error_that_leaves_the_bound_again_settles_only_after_its_return():
    error = np.array([0.3, 0.01, 0.06, 0.04, -0.03])
    assert settling_time(np.arange(5.0), error, 0.05) == 3.0
    assert settling_time(np.arange(5.0), error, 0.02) is None
    assert settling_time(np.arange(5.0), error, 0.5) == 0.0


def test_scores_of_a_known_run():
    time_s = np.arange(100.0)
    reference = np.linspace(1.0, 0.5, 100)
    error = np.where(time_s < 10, 0.2, 0.01)
    score = score_soc(time_s + 1000.0, reference + error, np.full(100, 0.01), reference)
    assert score.soc_rmse == pytest.approx(np.sqrt(0.1 * 0.04 + 0.9 * 1e-4))
    assert score.soc_max_error_after_60s == pytest.approx(0.01)
    assert score.settle_5_s == score.settle_2_s == 10.0
    assert score.inside_3_sigma == pytest.approx(0.9)


def test_rows_without_reference_do_not_count():
    reference = np.array([np.nan, 0.5, np.nan])
    score = score_soc(np.arange(3.0), np.array([0.0, 0.5, 1.0]), np.full(3, 0.1), reference)
    assert score.soc_rmse == 0.0
    assert np.isnan(score.soc_max_error_after_60s)


def test_no_reference_no_score():
    assert score_soc(np.arange(3.0), np.zeros(3), np.ones(3), np.full(3, np.nan)) is None


@pytest.mark.parametrize(("claimed", "nees"), [(1.0, 1.0), (0.5, 4.0), (2.0, 0.25)])
def test_nees_tells_a_sigma_that_is_too_small_from_one_that_is_too_large(claimed, nees):
    reference = np.linspace(0.9, 0.2, 20_000)
    error = 0.01 * np.random.default_rng(3).normal(size=reference.size)
    score = score_soc(
        0.1 * np.arange(reference.size), reference + error, np.full(reference.size, 0.01 * claimed), reference
    )
    assert score.nees == pytest.approx(nees, rel=0.05)
    assert score.sigma_rms == pytest.approx(0.01 * claimed)


def test_a_bias_has_a_sign_and_does_not_hide_in_the_rmse():
    reference = np.full(100, 0.5)
    low = score_soc(np.arange(100.0), reference - 0.03, np.full(100, 0.02), reference)
    assert low.soc_bias == pytest.approx(-0.03)
    assert low.soc_rmse == pytest.approx(0.03)
    assert (low.settle_5_s, low.settle_2_s) == (0.0, None)


def test_a_run_starts_at_its_first_row_also_where_no_reference_is_known_there():
    reference = np.where(np.arange(100) < 50, np.nan, 0.5)
    score = score_soc(np.arange(100.0) + 5000.0, np.full(100, 0.5), np.full(100, 0.01), reference)
    assert score.settle_5_s == 0.0
    assert score.soc_max_error_after_60s == 0.0


@given(st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=60), st.floats(0.001, 0.2))
def test_after_the_settling_time_the_error_stays_within_and_just_before_it_did_not(errors, bound):
    error, elapsed_s = np.array(errors), np.arange(float(len(errors)))
    settled_s = settling_time(elapsed_s, error, bound)
    if settled_s is None:
        assert abs(error[-1]) > bound
    else:
        assert (np.abs(error[elapsed_s >= settled_s]) <= bound).all()
        assert settled_s == 0.0 or abs(error[int(settled_s) - 1]) > bound


@given(st.lists(st.floats(-0.3, 0.3), min_size=2, max_size=60))
def test_the_scores_of_a_run_agree_with_each_other(errors):
    error = np.array(errors)
    reference = np.full(error.size, 0.5)
    score = score_soc(30.0 * np.arange(error.size), reference + error, np.full(error.size, 0.05), reference)
    assert abs(score.soc_bias) <= score.soc_rmse + 1e-12
    assert score.nees == pytest.approx((score.soc_rmse / 0.05) ** 2)
    assert 0.0 <= score.inside_3_sigma <= 1.0
    assert score.settle_2_s is None or score.settle_5_s <= score.settle_2_s


def test_a_sigma_of_nothing_is_a_lie_and_no_division_by_zero():
    score = score_soc(np.arange(3.0), np.full(3, 0.6), np.zeros(3), np.full(3, 0.5))
    assert np.isfinite(score.nees)
    assert score.inside_3_sigma == 0.0
