"""What holds for every filter, whatever a drive looks like: charge, covariance, sigma, and refusals by name."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.ocv import OCV_METHODS, OcvCurve
from app.estimation.errors import EstimatorError, ModelError
from app.estimation.filters.estimators import FILTERS, make_estimator
from app.estimation.health.capacity import CapacityTracker
from app.estimation.health.learned import learned
from app.estimation.prediction.driver_soc import DriverSoc
from app.estimation.scoring import score_soc, settling_time
from tests.campaign import examples

CELL = load_cell()
RECURSIVE = [name for name in FILTERS if name not in ("coulomb", "fused")]
N = 4

drives = st.lists(st.tuples(st.sampled_from([0.0, 0.1, 1.0, 10.0]), st.floats(-100.0, 200.0)), min_size=1, max_size=20)
socs = st.floats(0.2, 0.8)


def started(name, soc):
    estimator = make_estimator(name, CELL, N)
    estimator.start(CELL.ocv.voltage(np.full(N, soc)), np.full(N, 25.0), 0.0, np.full(N, soc))
    return estimator


def blind():
    return np.full(N, np.nan)


@settings(max_examples=examples(25))
@given(drives, socs)
def test_the_count_conserves_charge(drive, soc):
    estimator = started("coulomb", soc)
    for dt_s, current_a in drive:
        found = estimator.step(dt_s, current_a, blind(), np.full(N, 25.0))
    drawn, given_back = (sum(dt_s * max(sign * a, 0.0) for dt_s, a in drive) / 3600.0 for sign in (1.0, -1.0))
    moved_ah = drawn - given_back * CELL.coulombic_efficiency
    assert found.soc == pytest.approx(np.full(N, soc - moved_ah / CELL.capacity_ah), abs=1e-9)


@settings(max_examples=examples(10))
@given(st.sampled_from(RECURSIVE), drives, socs)
def test_a_filter_without_voltages_counts_charge_as_well(name, drive, soc):
    filtered, counted = started(name, soc), started("coulomb", soc)
    for dt_s, current_a in drive:
        found = filtered.step(dt_s, current_a, blind(), np.full(N, 25.0))
        wanted = counted.step(dt_s, current_a, blind(), np.full(N, 25.0))
    assert found.soc == pytest.approx(wanted.soc, abs=2e-3)
    assert not found.accepted.any()
    assert np.isnan(found.innovation_v).all()


@settings(max_examples=examples(10))
@given(st.sampled_from(RECURSIVE), socs, st.floats(-50.0, 100.0))
def test_the_variance_of_the_soc_grows_while_no_voltage_comes(name, soc, current_a):
    estimator, variances = started(name, soc), []
    for _ in range(12):
        estimator.step(10.0, current_a, blind(), np.full(N, 25.0))
        variances.append(estimator.state_cov[:, 0, 0].copy())
    assert all((after > before).all() for before, after in pairwise(variances))


@settings(max_examples=examples(10))
@given(socs, st.floats(-50.0, 100.0))
def test_the_counts_sigma_grows(soc, current_a):
    estimator = started("coulomb", soc)
    sigmas = [estimator.step(10.0, current_a, blind(), np.full(N, 25.0)).soc_sigma for _ in range(12)]
    assert all((after > before).all() for before, after in pairwise(sigmas))


@settings(max_examples=examples(10))
@given(st.sampled_from(RECURSIVE), drives, socs)
def test_covariance_is_symmetric_and_not_negative(name, drive, soc):
    estimator = started(name, soc)
    for dt_s, current_a in drive:
        estimator.step(dt_s, current_a, CELL.ocv.voltage(np.full(N, soc)), np.full(N, 25.0))
    cov = estimator.state_cov
    assert (cov == np.swapaxes(cov, 1, 2)).all()
    assert np.linalg.eigvalsh(cov).min() >= -1e-15


@settings(max_examples=examples(10))
@given(st.sampled_from(FILTERS), st.permutations(range(N)), drives)
def test_the_order_of_the_cells_does_not_matter(name, order, drive):
    order = np.array(order)
    soc = np.linspace(0.3, 0.7, N)
    rest, degc = CELL.ocv.voltage(soc), np.linspace(15.0, 35.0, N)
    plain, mixed = (make_estimator(name, CELL, N) for _ in range(2))
    plain.start(rest, degc, 0.0)
    mixed.start(rest[order], degc[order], 0.0)
    for dt_s, current_a in drive:
        first = plain.step(dt_s, current_a, rest, degc)
        second = mixed.step(dt_s, current_a, rest[order], degc[order])
    np.testing.assert_allclose(second.numbers, first.numbers[:, order], rtol=1e-9, atol=1e-12, equal_nan=True)


@pytest.mark.parametrize("name", FILTERS)
def test_a_voltage_that_disagrees_moves_the_filters_and_not_the_count(name):
    estimator = started(name, 0.5)
    for _ in range(600):
        found = estimator.step(1.0, 0.0, CELL.ocv.voltage(np.full(N, 0.55)), np.full(N, 25.0))
    if name == "coulomb":
        assert found.soc == pytest.approx(np.full(N, 0.5))
    else:
        assert (found.soc > 0.52).all()
        assert (found.soc < 0.56).all()


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("dt_s", [-1e-9, float("nan"), float("inf"), -float("inf")])
def test_a_step_that_is_no_time_is_refused_and_changes_nothing(name, dt_s):
    estimator = started(name, 0.5)
    before = estimator.step(0.0, 0.0, blind(), np.full(N, 25.0)).soc.copy()
    with pytest.raises(EstimatorError):
        estimator.step(dt_s, 0.0, blind(), np.full(N, 25.0))
    assert estimator.step(0.0, 0.0, blind(), np.full(N, 25.0)).soc == pytest.approx(before, abs=1e-12)


points = st.lists(st.floats(0.0, 1.0), min_size=4, max_size=12, unique=True).map(sorted)


@given(points, st.lists(st.floats(0.001, 0.3), min_size=12, max_size=12))
def test_an_interpolated_curve_never_falls_and_meets_its_points(soc, rises):
    soc = np.array(soc)
    if np.diff(soc).min() < 1e-3:
        return
    volts = 3.0 + np.cumsum(rises)[: soc.size]
    curve = OcvCurve(soc, volts)
    np.testing.assert_allclose(curve.voltage(soc), volts, atol=1e-9)
    assert (np.diff(curve.voltage(np.linspace(-0.05, 1.05, 777))) >= -1e-9).all()
    assert (curve.slope(np.linspace(-0.05, 1.05, 777)) >= -1e-9).all()


@given(st.floats(-0.04, 1.04))
def test_the_inverse_of_the_cells_curve_is_its_inverse(soc):
    assert CELL.ocv.soc_at(CELL.ocv.voltage([soc]))[0] == pytest.approx(soc, abs=2e-3)


@pytest.mark.parametrize("method", OCV_METHODS)
@pytest.mark.parametrize(
    ("soc", "volts"),
    [
        ([0.5], [3.7]),
        ([0.0, 1.0], [3.0, np.nan]),
        ([0.0, np.inf], [3.0, 4.0]),
        ([1.0, 0.0], [4.0, 3.0]),
        ([0.5, 0.5], [3.6, 3.7]),
        ([0.0, 0.5, 1.0], [3.0, 3.7]),
        ([0.0, 1.0], [4.2, 3.0]),
    ],
)
def test_points_that_are_no_curve_are_refused(soc, volts, method):
    with pytest.raises(ModelError):
        OcvCurve(np.array(soc), np.array(volts), method)


@settings(max_examples=examples(25))
@given(st.floats(0.7, 1.1), st.lists(st.floats(0.2, 0.9), min_size=5, max_size=15))
def test_exact_stretches_lead_to_the_capacity_and_make_it_surer(share, moves):
    tracker = CapacityTracker(25.0, 1)
    sigmas = [tracker.sigma_ah()[0]]
    for moved in moves:
        tracker.observe([moved], 0.002, moved * 25.0 * share, 0.02)
        sigmas.append(tracker.sigma_ah()[0])
    assert tracker.capacity_ah()[0] == pytest.approx(25.0 * share, rel=0.03)
    assert sigmas[-1] < sigmas[0]


@given(st.floats(0.1, 0.9), st.floats(0.7, 1.1))
def test_a_charge_tells_the_same_as_a_discharge(moved, share):
    out, back = CapacityTracker(25.0, 1), CapacityTracker(25.0, 1)
    out.observe([moved], 0.01, moved * 25.0 * share, 0.1)
    back.observe([-moved], 0.01, -moved * 25.0 * share, 0.1)
    assert out.capacity_ah() == pytest.approx(back.capacity_ah())
    assert out.sigma_ah() == pytest.approx(back.sigma_ah())


@given(st.lists(st.floats(-0.0999, 0.0999) | st.just(float("nan")), min_size=N, max_size=N))
def test_a_short_stretch_or_none_teaches_nothing(moved):
    tracker = CapacityTracker(25.0, N)
    before = tracker.state
    tracker.observe(moved, 0.01, 1.0, 0.01)
    np.testing.assert_array_equal(tracker.state, before)


sigma = st.floats(0.0, 10.0)


@given(st.lists(st.tuples(st.floats(1.0, 40.0), sigma, st.floats(0.2, 5.0), sigma), min_size=1, max_size=8))
def test_what_is_counted_with_is_learned_or_the_cell_file_and_nothing_between(cells):
    capacity, capacity_sigma, factor, factor_sigma = map(np.array, zip(*cells, strict=True))
    nominal = np.full(len(cells), 25.0)
    found = learned(nominal, capacity, capacity_sigma, factor, factor_sigma)
    np.testing.assert_array_equal(found.capacity_ah, np.where(found.has_capacity, capacity, nominal))
    np.testing.assert_array_equal(found.resistance_factor, np.where(found.has_resistance, factor, 1.0))


@given(st.lists(st.lists(st.floats(0.0, 1.0), min_size=N, max_size=N), min_size=1, max_size=130))
def test_the_driver_never_reads_more_than_the_lowest_cells_mean(samples):
    driver = DriverSoc(N)
    for soc in samples:
        reading = driver.step(soc)
    means = np.mean(samples[-100:], axis=0)
    assert reading.percent <= 100.0 * means.min() + 0.05 + 1e-9
    assert reading.percent > 100.0 * means.min() - 1.06
    assert reading.spread_percent == pytest.approx(100.0 * np.ptp(means), abs=0.11)
    assert 0 <= reading.percent <= 100


@given(st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=40), st.floats(0.001, 0.4))
def test_after_the_settling_time_the_error_stays_inside(errors, bound):
    errors = np.array(errors)
    at_s = settling_time(np.arange(errors.size, dtype=float), errors, bound)
    if at_s is None:
        assert abs(errors[-1]) > bound
    else:
        assert (np.abs(errors[int(at_s) :]) <= bound).all()
        assert at_s == 0.0 or abs(errors[int(at_s) - 1]) > bound


@given(st.floats(-0.2, 0.2), st.floats(0.001, 0.1))
def test_a_constant_error_has_its_own_size_in_every_score(error, sigma):
    reference = np.linspace(0.9, 0.2, 200)
    score = score_soc(np.arange(200.0), reference + error, np.full(200, sigma), reference)
    assert score.soc_rmse == pytest.approx(abs(error), abs=1e-12)
    assert score.soc_bias == pytest.approx(error, abs=1e-12)
    assert score.soc_max_error_after_60s == pytest.approx(abs(error), abs=1e-12)
    assert score.nees == pytest.approx((error / sigma) ** 2, abs=1e-9)
    assert score.sigma_rms == pytest.approx(sigma)
