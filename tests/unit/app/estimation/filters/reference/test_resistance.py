"""The regression of resistances, as `reference/resistance.py` writes it down."""

import numpy as np
import pytest

from app.estimation.filters.reference.resistance import LASTING_S, RESTART_S, ReferenceResistance, Regression

DT_S = 0.1


def regressed(y, x, dt_s=DT_S):
    kept = Regression(np.zeros((2, 1)), np.zeros(1, bool), np.zeros((3, 1)), np.zeros(1))
    for drops in zip(y, x, strict=True):
        kept = kept.step(dt_s, np.array(drops)[:, None])
    return kept


def test_drops_that_are_all_larger_by_a_factor_give_that_factor():
    x = 0.1 * np.sign(np.sin(np.arange(600) * 0.3))
    factor, sigma = regressed(1.3 * x, x).judge(np.ones(1), np.full(1, 1e-9))[:, 0]
    assert factor == pytest.approx(1.3)
    assert sigma == pytest.approx((2.0 * LASTING_S * 1e-6 / (DT_S * np.sum(x[1:] ** 2))) ** 0.5, rel=0.2)


def test_the_first_drop_and_the_first_after_a_hole_tell_nothing():
    kept = regressed([0.1], [0.1])
    assert kept.weight_s == 0.0
    assert kept.step(2.0 * RESTART_S, np.full((2, 1), 0.9)).weight_s == 0.0


def test_without_a_drive_the_prior_stays():
    learned = ReferenceResistance(np.array([1.2]), np.array([16.0]))
    np.testing.assert_allclose(learned.judge(), [[1.2], [0.25]])
