"""Promises at the edges: samples that are missing or impossible, empty records, pauses, ends of the tables."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.errors import ShapeError
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.tuning import Tuning
from tests.oracle.cells import MODEL

TUNING = Tuning()
DEGC = np.full(1, 25.0)


def started(soc=0.6, told=None, current_a=0.0, name="fused"):
    estimator = make_estimator(name, MODEL, 1)
    estimator.start(MODEL.ocv.voltage(np.array([soc])), DEGC, current_a, told)
    return estimator


def test_a_record_of_no_samples_answers_with_no_rows_and_moves_nothing():
    estimator = started()
    before = estimator.state_mean
    found = estimator.run(np.empty(0), np.empty(0), np.empty((0, 1)), np.empty((0, 1)))
    assert found.soc.shape == (0, 1)
    np.testing.assert_array_equal(estimator.state_mean, before)


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf, 1e9])
def test_a_current_that_is_missing_or_impossible_is_the_last_one(broken):
    volts = MODEL.ocv.voltage(np.array([0.6]))
    measured, missing = started(told=0.6, current_a=5.0), started(told=0.6, current_a=5.0)
    for _ in range(20):
        one, other = measured.step(1.0, 5.0, volts, DEGC), missing.step(1.0, broken, volts, DEGC)
    np.testing.assert_array_equal(one.numbers, other.numbers)


@pytest.mark.parametrize(("dt_s", "lasts_s"), [(0.1, 1.0), (0.1, 9.0), (1.0, 60.0), (20.0, 600.0)])
@pytest.mark.parametrize("left_v", [-0.5, -0.1, 0.0, 0.1, 0.5])
def test_a_pause_with_whatever_relaxation_leaves_numbers_and_a_sigma(dt_s, lasts_s, left_v):
    estimator, ocv = started(told=0.6), MODEL.ocv.voltage(np.array([0.6]))
    for k in range(round(lasts_s / dt_s)):
        volts = ocv + left_v * np.exp(-k * dt_s / 5.0)
        found = estimator.step(dt_s, 0.0, volts, DEGC)
        assert 0.0 <= found.soc[0] <= 1.0
        assert 0.0 < found.soc_sigma[0] <= 0.5
    found = estimator.step(dt_s, 10.0, ocv, DEGC)
    assert np.isfinite(found.soc[0])
    assert 0.0 < found.soc_sigma[0] <= 0.5


def relaxing(told, left_s, tuning=TUNING):
    """Return the estimates of 5 minutes from a start at 60 %, where what 1C drops is left and relaxes within left_s."""
    estimator, ocv = make_estimator("fused", MODEL, 1, tuning), MODEL.ocv.voltage(np.array([0.6]))
    left_v = MODEL.drop_per_c_v * np.exp(-0.1 * np.arange(3000) / left_s)[:, None]
    estimator.start(ocv - left_v[0], DEGC, 0.0, told)
    n = len(left_v)
    return estimator.run(np.full(n, 0.1), np.zeros(n), ocv - left_v, np.full((n, 1), 25.0))


@pytest.mark.parametrize("left_s", [30.0, 60.0, 120.0])
def test_who_wakes_up_while_a_cell_relaxes_knows_that_its_voltage_is_no_ocv(left_s):
    found = relaxing(None, left_s)
    assert (np.abs(found.soc - 0.6) < 3.0 * found.soc_sigma).all()


def test_a_soc_that_was_given_is_no_less_sure_for_what_a_rest_may_have_left():
    never = replace(TUNING, rest_unsettled=0.0)
    np.testing.assert_array_equal(relaxing(0.6, 120.0).soc_sigma, relaxing(0.6, 120.0, never).soc_sigma)


def test_a_pause_that_ends_at_once_leaves_no_uncertainty_about_its_voltage():
    ocv, left_v = MODEL.ocv.voltage(np.array([0.6])), 0.05 * np.exp(-0.3 * np.arange(20))
    sigma = []
    for tuning in (TUNING, replace(TUNING, rest_unsettled=0.0)):
        estimator = make_estimator("fused", MODEL, 1, tuning)
        estimator.start(ocv - left_v[0], DEGC, 0.0)
        for volts in ocv - left_v:
            paused = estimator.step(0.1, 0.0, np.full(1, volts), DEGC).soc_sigma[0]
        driven = [estimator.step(0.1, 10.0, ocv - 0.1, DEGC).soc_sigma[0] for _ in range(20)][-1]
        sigma.append((paused, driven))
    (uncertaintying, after), (trusting, never) = sigma
    assert uncertaintying > 1.2 * trusting
    assert after == never


@pytest.mark.parametrize("dt_s", [0.1, 1.0])
def test_a_car_that_is_switched_on_at_rest_is_no_less_sure_for_the_noise_of_its_sensors(dt_s):
    n, n_cells = round(60.0 / dt_s), 96
    noise_v = TUNING.rest_noise_v * np.random.default_rng(5).normal(size=(n + 1, n_cells))
    volts, degc = MODEL.ocv.voltage(np.array([0.6])) + noise_v, np.full((n + 1, n_cells), 25.0)
    sigma = []
    for tuning in (TUNING, replace(TUNING, rest_unsettled=0.0)):
        estimator = make_estimator("fused", MODEL, n_cells, tuning)
        estimator.start(volts[0], degc[0], 0.0)
        sigma.append(estimator.run(np.full(n, dt_s), np.zeros(n), volts[1:], degc[1:]).soc_sigma)
    uncertaintying, trusting = sigma
    np.testing.assert_allclose(uncertaintying.mean(axis=1), trusting.mean(axis=1), rtol=0.02)
    assert 3.0 * uncertaintying[round(16.0 / dt_s) :].max() < 0.1, "a number, not a range"


def test_the_longer_a_settled_rest_lasts_the_surer_is_a_start_that_it_confirms():
    estimator, ocv = started(told=0.6), MODEL.ocv.voltage(np.array([0.6]))
    sigmas = [estimator.step(0.1, 0.0, ocv, DEGC).soc_sigma[0] for _ in range(round(TUNING.rest_s / 0.1) + 10)]
    assert sigmas[-1] < sigmas[round(2.0 * TUNING.weighing_s / 0.1)]


@pytest.mark.parametrize("degc", [-40.0, -20.0, 60.0, 100.0])
def test_at_temperatures_that_nobody_measured_a_rest_is_read_with_more_uncertainty_than_at_25_degc(degc):
    sigma = []
    for cell_degc in (25.0, degc):
        estimator, ocv = make_estimator("fused", MODEL, 1), MODEL.ocv.voltage(np.array([0.6]))
        here = np.full(1, cell_degc)
        estimator.start(ocv, here, 0.0, 0.6)
        for _ in range(40):
            found = estimator.step(0.1, 0.0, ocv, here)
        sigma.append(found.soc_sigma[0])
    assert sigma[1] > 0.9 * sigma[0]


@pytest.mark.parametrize("soc", [0.0, 0.01, 0.99, 1.0])
def test_a_rest_at_the_ends_of_the_tables_stays_between_empty_and_full(soc):
    estimator, ocv = started(soc, told=soc), MODEL.ocv.voltage(np.array([soc]))
    for side_v in (-0.3, 0.3):
        found = estimator.step(1.0, 0.0, ocv + side_v, DEGC)
        assert 0.0 <= found.soc[0] <= 1.0


@pytest.mark.parametrize("what", ["current_a", "voltage_v", "temperature_degc"])
def test_a_record_whose_arrays_do_not_fit_says_which_one(what):
    record = {
        "dt_s": np.ones(3),
        "current_a": np.ones(3),
        "voltage_v": np.full((3, 1), 3.7),
        "temperature_degc": np.full((3, 1), 25.0),
    }
    record[what] = record[what][:2]
    with pytest.raises(ShapeError, match=what):
        started().run(**record)
