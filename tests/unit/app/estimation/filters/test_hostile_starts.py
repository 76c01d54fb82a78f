"""Promises at the edges: samples that are missing or impossible, empty records, pauses, ends of the tables."""

import numpy as np
import pytest

from app.estimation.errors import ShapeError
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.tuning import Tuning
from tests.unit.app.estimation.filters.reference.cells import MODEL

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


def test_the_longer_a_settled_rest_lasts_the_surer_is_a_start_that_it_confirms():
    estimator, ocv = started(told=0.6), MODEL.ocv.voltage(np.array([0.6]))
    sigmas = [estimator.step(0.1, 0.0, ocv, DEGC).soc_sigma[0] for _ in range(round(TUNING.rest_s / 0.1) + 10)]
    assert sigmas[-1] < sigmas[round(TUNING.rest_least_s / 0.1)]


@pytest.mark.parametrize("degc", [-40.0, -20.0, 60.0, 100.0])
def test_at_temperatures_that_nobody_measured_a_rest_is_read_with_more_doubt_than_at_25_degc(degc):
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
