import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.filters.estimators import FILTERS, make_estimator

N = 3


def started(name, soc=None):
    estimator = make_estimator(name, load_cell(), N)
    rest = load_cell().ocv.voltage([0.5, 0.6, 0.7])
    estimator.start(rest, np.full(N, 25.0), 0.0, soc)
    return estimator, rest


@pytest.mark.parametrize("name", FILTERS)
def test_start_without_a_soc_reads_it_off_the_rest_voltage(name):
    estimator, _ = started(name)
    np.testing.assert_allclose(estimator.state_mean[0], [0.5, 0.6, 0.7], atol=0.02)


@pytest.mark.parametrize("name", ["coulomb", "ekf", "ukf", "cdkf"])
def test_plain_filters_start_from_the_soc_they_are_given(name):
    estimator, _ = started(name, soc=[0.3, np.nan, 0.4])
    np.testing.assert_allclose(estimator.state_mean[0], [0.3, 0.6, 0.4], atol=0.02)


def test_fused_keeps_the_soc_as_a_second_opinion():
    estimator, rest = started("fused", soc=[0.505, 0.1, 0.7])
    np.testing.assert_allclose(estimator.counted_soc, [0.505, 0.1, 0.7])
    soc = estimator.step(0.1, 0.0, rest, np.full(N, 25.0)).soc
    assert 0.5 < soc[0] < 0.506
    assert soc[1] == pytest.approx(0.6, abs=5e-3)


@pytest.mark.parametrize("name", FILTERS)
def test_every_array_of_an_estimate_is_one_value_a_cell(name):
    estimator, rest = started(name)
    estimates = estimator.step(0.1, 5.0, rest, np.full(N, 25.0))
    assert estimates.numbers.shape == (8, N)
    assert estimates.soc.shape == estimates.accepted.shape == (N,)
    assert estimator.state_mean.shape == (3, N)
    assert estimator.state_cov.shape == (N, 3, 3)


@pytest.mark.parametrize("name", FILTERS)
def test_inputs_are_not_written_to(name):
    estimator, rest = started(name)
    volts, degc = rest.copy(), np.array([25.0, np.nan, 25.0])
    before = volts.copy(), degc.copy()
    first = estimator.step(0.1, 5.0, volts, degc)
    kept = first.soc.copy()
    estimator.step(0.1, 5.0, volts, degc)
    np.testing.assert_array_equal(volts, before[0])
    np.testing.assert_array_equal(degc, before[1])
    np.testing.assert_array_equal(first.soc, kept)


@pytest.mark.parametrize("name", FILTERS)
def test_broken_contracts_are_named(name):
    estimator = make_estimator(name, load_cell(), N)
    with pytest.raises(EstimatorError, match="started"):
        estimator.step(0.1, 0.0, np.full(N, 3.7), np.full(N, 25.0))
    with pytest.raises(ShapeError, match="voltages_v"):
        estimator.start(np.full(2, 3.7), np.full(N, 25.0), 0.0)
    with pytest.raises(ShapeError, match="soc"):
        estimator.start(np.full(N, 3.7), np.full(N, 25.0), 0.0, soc=[0.5, 0.5])
    estimator.start(np.full(N, 3.7), np.full(N, 25.0), 0.0)
    for dt in (-0.1, np.nan, np.inf):
        with pytest.raises(EstimatorError):
            estimator.step(dt, 0.0, np.full(N, 3.7), np.full(N, 25.0))


def test_an_unknown_filter_lists_the_known():
    with pytest.raises(EstimatorError, match="fused, coulomb, ekf, ukf, cdkf"):
        make_estimator("kalman", load_cell(), 1)
    with pytest.raises(EstimatorError, match="0 cells"):
        make_estimator("ukf", load_cell(), 0)


def test_counting_is_exact_and_its_sigma_grows():
    estimator, rest = started("coulomb", soc=0.9)
    first = estimator.step(0.0, 25.0, rest, np.full(N, 25.0))
    for _ in range(600):
        estimates = estimator.step(1.0, 25.0, rest, np.full(N, 25.0))
    np.testing.assert_allclose(estimates.soc, 0.9 - 600.0 / 3600.0)
    assert estimates.soc_sigma[0] > first.soc_sigma[0] > 0.0
    assert not estimates.accepted.any()


def test_a_temperature_that_goes_missing_is_the_last_one():
    both = [started("cdkf")[0] for _ in range(2)]
    rest = started("cdkf")[1]
    for estimator in both:
        estimator.step(0.1, 50.0, rest, np.full(N, 5.0))
    known = both[0].step(0.1, 50.0, rest, np.full(N, 5.0))
    missing = both[1].step(0.1, 50.0, rest, np.full(N, np.nan))
    np.testing.assert_array_equal(known.voltage_v, missing.voltage_v)
