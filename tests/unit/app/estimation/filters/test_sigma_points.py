import numpy as np
import pytest

from app.estimation.filters.sigma_points import central_difference, unscented


@pytest.mark.parametrize("rule", [unscented(3), unscented(5), unscented(1, alpha=1.0), central_difference(2)])
def test_mean_weights_sum_to_one_and_points_have_unit_variance(rule):
    assert rule.centre_mean + 2 * rule.n_dim * rule.weight == pytest.approx(1.0)
    assert 2 * rule.weight * rule.spread**2 == pytest.approx(1.0)


def test_scaled_spread_is_the_source_s():
    rule = unscented(5)
    assert rule.spread == pytest.approx(np.sqrt(0.1**2 * 5))
    assert rule.centre_cov - rule.centre_mean == pytest.approx(1.0 - 0.01 + 2.0)


@pytest.mark.parametrize("rule", [unscented(3), unscented(5), central_difference(3)])
def test_curvature_is_the_variance_a_parabola_adds(rule):
    """h(z) = z^2 with unit variance along one direction: sum the whole set by its weights."""
    c = rule.spread
    outputs = np.concatenate(([0.0, c * c, c * c], np.zeros(2 * (rule.n_dim - 1))))
    mean_weights = np.array([rule.centre_mean] + [rule.weight] * (2 * rule.n_dim))
    cov_weights = np.array([rule.centre_cov] + [rule.weight] * (2 * rule.n_dim))
    mean = mean_weights @ outputs
    q = 2.0 * c * c
    assert rule.curvature * q * q == pytest.approx(cov_weights @ (outputs - mean) ** 2)
    assert rule.curvature > 0.0
