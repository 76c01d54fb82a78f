"""The regression of resistances: a factor that all drops share, and a prior where there are none."""

import numpy as np
import pytest

from app.estimation.filters.engine.native_resistance import LASTING_S, NativeResistance
from app.estimation.filters.estimates import N_OUT, OUT_OCV, OUT_VOLTAGE
from tests.oracle.resistance import RESTART_S

DT_S = 0.1
PRIOR = np.array([1.2]), np.array([16.0])


def regressed(y, x, dt_s=DT_S, prior=PRIOR):
    """Factor and sigma after measured and modelled drops of one cell, `dt_s` apart."""
    numbers = np.zeros((len(y), N_OUT, 1))
    numbers[:, OUT_OCV], numbers[:, OUT_VOLTAGE] = 4.0, 4.0 - np.asarray(x)[:, None]
    regression = NativeResistance(*prior)
    regression.record(np.full(len(y), dt_s), numbers, np.ones(1), 4.0 - np.asarray(y)[:, None])
    return regression.judge()[:, 0]


def test_drops_that_are_all_larger_by_a_factor_give_that_factor():
    x = 0.1 * np.sign(np.sin(np.arange(600) * 0.3))
    factor, sigma = regressed(1.3 * x, x, prior=(np.ones(1), np.full(1, 1e-9)))
    assert factor == pytest.approx(1.3)
    assert sigma == pytest.approx((2.0 * LASTING_S * 1e-6 / (DT_S * np.sum(x[1:] ** 2))) ** 0.5, rel=0.2)


@pytest.mark.parametrize("drops", [[], [0.1], [0.1, 0.9, 0.2]])
def test_without_drops_the_first_one_and_those_after_holes_the_prior_stays(drops):
    np.testing.assert_allclose(regressed(drops, drops, 2.0 * RESTART_S), [1.2, 0.25])
