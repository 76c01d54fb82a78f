"""Covariances stay positive definite and estimates finite under hostile cell-steps, a million in the campaign."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import FILTERS, make_estimator
from tests.campaign import of_size
from tests.oracle.both_engines import hostile_steps

N_CELLS, N_STEPS = (
    500,
    of_size(200, 700, 1400, 2000),
)  # x 3 recursive filters: a million cell-steps in the short campaign


@pytest.mark.parametrize("name", ["ekf", "ukf", "cdkf"])
def test_covariance_stays_definite(name):
    estimator = make_estimator(name, load_cell(), N_CELLS)
    rng = np.random.default_rng(5)
    estimator.start(rng.uniform(2.5, 4.2, N_CELLS), np.full(N_CELLS, 25.0), 0.0, rng.random(N_CELLS), 0.5)
    for k, (dt, current, volts, degc) in enumerate(hostile_steps(11, N_STEPS, N_CELLS)):
        estimates = estimator.step(dt, current, volts, degc)
        if k % 20 == 0 or k == N_STEPS - 1:
            cov = estimator.state_cov
            assert (cov == np.swapaxes(cov, 1, 2)).all()
            root = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
            assert np.linalg.eigvalsh(cov / (root[:, :, None] * root[:, None, :])).min() > 0.0
        assert np.isfinite(estimates.soc).all()
        assert np.isfinite(estimates.soc_sigma).all()
        assert ((estimates.soc >= 0.0) & (estimates.soc <= 1.0)).all()


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_answers_finite_numbers(name):
    base = load_cell()
    model = replace(base, hysteresis_v=0.02, overpotential_v=np.full(base.r0_ohm.shape, 0.01))
    estimator = make_estimator(name, model, 40)
    estimator.start(np.full(40, np.nan), np.full(40, np.nan), np.nan)
    for dt, current, volts, degc in hostile_steps(3, 300, 40):
        estimates = estimator.step(dt, current, volts, degc)
        for values in (estimates.soc, estimates.soc_sigma, estimates.ocv_v, estimates.voltage_v):
            assert np.isfinite(values).all()
        assert (estimates.soc_sigma > 0.0).all()
        measured = (volts > 0.5) & (volts < 6.0)
        assert (np.isfinite(estimates.innovation_v) == measured).all()
