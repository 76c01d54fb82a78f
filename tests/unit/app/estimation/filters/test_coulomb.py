import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError
from app.estimation.filters.estimators import make_estimator

CELL = load_cell()


def counter(soc, n=1, **words):
    estimator = make_estimator("coulomb", CELL, n)
    estimator.start(np.full(n, 3.8), np.full(n, 25.0), 0.0, soc=soc, **words)
    return estimator


def test_an_hour_at_1c_empties_a_full_cell_and_charging_counts_the_efficiency():
    estimator = counter(1.0)
    for _ in range(36):
        estimates = estimator.step(100.0, CELL.capacity_ah, [3.7], [25.0])
    assert estimates.soc[0] == pytest.approx(0.0, abs=1e-9)
    estimator = counter(0.2)
    estimates = estimator.step(1800.0, -CELL.capacity_ah, [3.7], [25.0])
    assert estimates.soc[0] == pytest.approx(0.2 + 0.5 * CELL.coulombic_efficiency)


def test_no_voltage_ever_moves_it():
    high, low = counter(0.5), counter(0.5)
    for _ in range(100):
        a, b = high.step(1.0, 5.0, [4.2], [25.0]), low.step(1.0, 5.0, [3.0], [25.0])
    assert a.soc[0] == b.soc[0]
    assert not a.accepted.any()


def test_sigma_begins_as_told_and_never_shrinks():
    estimator = counter(0.5, soc_sigma=0.02)
    sigmas = [estimator.step(10.0, i, [3.7], [25.0]).soc_sigma[0] for i in (0.0, 50.0, -50.0, 0.0, 20.0)]
    assert sigmas[0] == pytest.approx(0.02, rel=1e-3)
    assert sigmas[1] > sigmas[0]
    assert sigmas[-1] > sigmas[0]


def test_a_model_that_does_not_fit_shows_in_the_innovation_and_is_called_invalid():
    estimator = counter(0.9)
    for _ in range(600):
        estimates = estimator.step(1.0, 0.0, [3.4], [25.0])
    assert estimates.innovation_v[0] == pytest.approx(3.4 - CELL.ocv.voltage(np.array([0.9]))[0], abs=0.01)
    assert not estimates.model_valid[0]


def test_a_step_before_the_start_is_refused():
    with pytest.raises(EstimatorError, match="not been started"):
        make_estimator("coulomb", CELL, 1).step(0.1, 0.0, [3.7], [25.0])
