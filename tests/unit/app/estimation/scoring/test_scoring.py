import numpy as np
import pytest

from app.estimation.scoring.scoring import score_soc, settling_time


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
