"""A record is so many samples, whichever way it is run, and arrays that do not fit are refused by name."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.filters.estimators import FILTERS, make_estimator
from app.estimation.filters.record import check_record, run_steps

CELL = load_cell("samsung-25r-10p")
STEPS, N = 400, 3


def samples():
    rng = np.random.default_rng(9)
    volts = 3.8 + 0.02 * rng.normal(size=(STEPS, N))
    volts[50:60, 1] = np.nan
    current = np.where(rng.random(STEPS) < 0.1, np.nan, 60.0 * rng.random(STEPS))
    degc = np.broadcast_to(25.0 + 0.01 * np.arange(STEPS)[:, None], (STEPS, N)).copy()
    return rng.choice([0.0, 0.1, 5.0], STEPS), current, volts, degc


@pytest.mark.parametrize("name", FILTERS)
def test_a_record_is_its_samples_one_by_one(name):
    dt, current, volts, degc = samples()
    whole, single = (make_estimator(name, CELL, N, engine="numpy") for _ in range(2))
    for estimator in (whole, single):
        estimator.start(volts[0], degc[0], 0.0, soc=0.7)
    expected, found = run_steps(single, dt, current, volts, degc), whole.run(dt, current, volts, degc)
    assert found.soc.shape == (STEPS, N)
    np.testing.assert_allclose(found.soc, expected.soc, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.soc_sigma, expected.soc_sigma, rtol=1e-9)
    np.testing.assert_array_equal(found.accepted, expected.accepted)


@pytest.mark.parametrize("wrong", ["dt_s", "current_a", "voltage_v", "temperature_degc"])
def test_an_array_of_another_shape_is_named(wrong):
    arrays = dict(zip(("dt_s", "current_a", "voltage_v", "temperature_degc"), samples(), strict=True))
    arrays[wrong] = arrays[wrong][:, None] if arrays[wrong].ndim == 1 else arrays[wrong][:, :1]
    with pytest.raises(ShapeError, match=wrong):
        check_record(N, **arrays)


@pytest.mark.parametrize("step", [-1.0, float("nan"), float("inf")])
def test_a_step_that_is_none_is_refused(step):
    dt, current, volts, degc = samples()
    dt[7] = step
    with pytest.raises(EstimatorError, match="step"):
        check_record(N, dt, current, volts, degc)
