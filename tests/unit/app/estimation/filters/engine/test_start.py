"""Where a filter begins."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.tuning import Tuning
from tests.open_loop import simulate
from tests.oracle.cells import MODEL


@pytest.mark.parametrize("soc", [0.2, 0.5, 0.9])
def test_a_rested_cell_starts_at_its_soc(soc):
    estimator = make_estimator("cdkf", MODEL, 1)
    estimator.start(MODEL.ocv.voltage(np.array([soc])), [25.0], 0.0)
    assert estimator.state_mean[0, 0] == pytest.approx(soc, abs=0.02)
    assert estimator.state_mean[1:, 0].tolist() == [0.0] * MODEL.n_rc


def test_in_a_plateau_every_soc_of_it_is_possible():
    flat = replace(MODEL, ocv=OcvCurve(np.array([0.0, 0.2, 0.8, 1.0]), np.array([3.0, 3.299, 3.301, 3.6])))
    estimator = make_estimator("cdkf", flat, 1)
    estimator.start([3.3], [25.0], 0.0)
    assert estimator.state_mean[0, 0] == pytest.approx(0.5, abs=0.05)
    assert np.sqrt(estimator.state_cov[0, 0, 0]) == pytest.approx(0.6 / np.sqrt(12.0), rel=0.2)


def test_a_voltage_beyond_full_and_empty_starts_there():
    estimator = make_estimator("cdkf", MODEL, 2)
    estimator.start([0.6, 5.9], [25.0, 25.0], 0.0)
    assert estimator.state_mean[0] == pytest.approx([0.0, 1.0], abs=0.02)


def test_a_start_under_load_covers_what_is_not_known_of_the_rc_pairs():
    current = np.concatenate((np.zeros(10), np.full(400, 100.0)))
    soc, volts = simulate(MODEL, 0.5 * np.arange(410), current, np.full(410, 25.0), 0.8)
    for row in (15, 60, 409):
        estimator = make_estimator("cdkf", MODEL, 1)
        estimator.start(volts[row : row + 1], [25.0], 100.0)
        error = estimator.state_mean[0, 0] - soc[row]
        assert abs(error) < 2.0 * np.sqrt(estimator.state_cov[0, 0, 0])
        assert (np.linalg.eigvalsh(estimator.state_cov[0]) > 0.0).all()


def test_a_cell_that_is_not_measured_starts_where_the_others_are_and_knows_nothing():
    estimator = make_estimator("cdkf", MODEL, 3)
    volts = MODEL.ocv.voltage(np.array([0.6, 0.6, 0.6]))
    volts[1] = np.nan
    estimator.start(volts, [25.0] * 3, 0.0)
    assert estimator.state_mean[0, 1] == pytest.approx(estimator.state_mean[0, 0])
    assert estimator.state_cov[1, 0, 0] == pytest.approx(0.25)


def test_without_any_voltage_every_soc_is_possible():
    estimator = make_estimator("cdkf", MODEL, 2)
    estimator.start([np.nan] * 2, [np.nan] * 2, np.nan)
    assert estimator.state_mean[0].tolist() == [0.5, 0.5]
    assert estimator.state_cov[:, 0, 0] == pytest.approx([0.25, 0.25])


def test_the_count_takes_an_initial_soc_and_the_filter_of_a_fusion_does_not():
    estimator = make_estimator("fused", MODEL, 2)
    estimator.start(MODEL.ocv.voltage(np.array([0.6, 0.6])), [25.0] * 2, 0.0, soc=[0.4, np.nan])
    assert estimator.counted_soc == pytest.approx([0.4, 0.6], abs=0.02)
    assert estimator.state_mean[0] == pytest.approx([0.6, 0.6], abs=0.02)


def count_from(soc, rest_soc, current_a=0.0, sigma=None, is_measured=True):
    """Return SOC and sigma that the count alone reports after a start at a SOC while the voltage said another."""
    estimator = make_estimator("coulomb", MODEL, 1)
    volts = MODEL.ocv.voltage(np.array([rest_soc])) if is_measured else np.array([np.nan])
    estimator.start(volts, [25.0], current_a, [soc], sigma)
    found = estimator.step(0.0, current_a, volts, [25.0])
    return found.soc[0], found.soc_sigma[0]


def test_a_soc_without_a_sigma_is_supposed_to_be_exact():
    assert count_from(0.63, 0.60) == pytest.approx((0.63, Tuning().counter_soc_sigma), abs=1e-3)


def test_a_soc_that_was_given_is_exact_or_roughly_right():
    estimator = make_estimator("fused", MODEL, 2)
    estimator.start([3.7, 3.7], [25.0, 25.0], MODEL.capacity_ah, [0.6, np.nan])
    weight, spread = estimator.engine.get("start_weight"), np.sqrt(estimator.engine.get("start_v2"))
    assert weight[0, 0] > weight[1, 0] > 0.0
    assert spread[:2, 0].tolist() == pytest.approx([Tuning().counter_soc_sigma, Tuning().rough_soc])
    assert not weight[:, 1].any()


def test_a_sigma_that_came_with_the_soc_is_kept():
    assert count_from(0.63, 0.60, sigma=[0.005])[1] == pytest.approx(0.005, rel=0.01)
    assert count_from(0.61, 0.60, sigma=[0.05])[1] == pytest.approx(0.05, rel=0.01)
