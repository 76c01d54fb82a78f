"""What one step answers: rows under their names, and for a missing sample a prediction but no innovation."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimates import N_OUT, Estimates
from app.estimation.filters.estimators import FILTERS, make_estimator

CELL = load_cell()
DEGC = np.full(4, 25.0)
NAMES = ("soc", "soc_sigma", "ocv_v", "voltage_v", "innovation_v", "innovation_sigma_v", "model_valid", "accepted")

every_filter = pytest.mark.parametrize("name", FILTERS)


def test_every_row_has_one_name():
    estimates = Estimates(np.arange(N_OUT * 3.0).reshape(N_OUT, 3))
    for row, name in enumerate(NAMES[:6]):
        np.testing.assert_array_equal(getattr(estimates, name), estimates.numbers[row])


@pytest.mark.parametrize("name", ["model_valid", "accepted"])
def test_yes_and_no_are_truth_values(name):
    numbers = np.zeros((N_OUT, 3))
    numbers[NAMES.index(name)] = (0.0, 1.0, 1.0)
    answer = getattr(Estimates(numbers), name)
    assert answer.dtype == bool
    assert answer.tolist() == [False, True, True]


@every_filter
def test_a_sample_is_the_prediction_and_the_innovation_together(name):
    estimator = make_estimator(name, CELL, 4)
    volts = CELL.ocv.voltage(np.array([0.3, 0.5, 0.7, 0.9]))
    estimator.start(volts, DEGC, 0.0)
    shown = volts + np.array([0.0, 0.001, -0.001, 0.002])
    found = estimator.step(0.1, 0.0, shown, DEGC)
    np.testing.assert_allclose(found.voltage_v + found.innovation_v, shown, atol=1e-12)
    np.testing.assert_allclose(found.ocv_v, CELL.open_circuit_voltage(found.soc, DEGC), atol=2e-3)
    assert (found.innovation_sigma_v > 0.0).all()
    assert (found.soc_sigma > 0.0).all()


@every_filter
def test_a_missing_or_impossible_voltage_has_a_prediction_but_no_innovation_and_is_not_used(name):
    estimator = make_estimator(name, CELL, 4)
    volts = CELL.ocv.voltage(np.full(4, 0.6))
    estimator.start(volts, DEGC, 0.0)
    shown = np.array([volts[0], np.nan, 0.0, 6.5535])
    found = estimator.step(0.1, 0.0, shown, DEGC)
    assert np.isnan(found.innovation_v).tolist() == [False, True, True, True]
    assert found.accepted[1:].tolist() == [False, False, False]
    assert np.isfinite(found.voltage_v).all()
    assert np.isfinite(found.soc).all()


@every_filter
def test_answers_belong_to_the_reader(name):
    estimator = make_estimator(name, CELL, 4)
    volts = CELL.ocv.voltage(np.full(4, 0.6))
    estimator.start(volts, DEGC, 0.0)
    found = estimator.step(0.1, 10.0, volts, DEGC)
    before = estimator.state_mean
    found.numbers[:] = np.nan
    estimator.state_mean[:] = np.nan
    estimator.state_cov[:] = np.nan
    np.testing.assert_array_equal(estimator.state_mean, before)
    assert np.isfinite(estimator.step(0.1, 10.0, volts, DEGC).soc).all()
