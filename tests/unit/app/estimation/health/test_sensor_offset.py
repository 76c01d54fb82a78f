import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.health.sensor_offset import OFFSET_SIGMA_C, OffsetTracker
from tests.open_loop import simulate

CELL = load_cell()
C_A = CELL.capacity_ah
OFFSET_A = 0.0067 * C_A


def tracked(current, dt_s, offset_a=OFFSET_A, gain=1.0, start_soc=0.8):
    """What is known of the offset after a run of a filter that hears voltages and the sensor as it errs."""
    rng = np.random.default_rng(3)
    n = current.size
    time_s = dt_s * np.arange(n)
    _, volts = simulate(CELL, time_s, current, np.full(n, 30.0), start_soc)
    volts = np.round(volts + rng.normal(0.0, 1.2e-3, n), 4)
    sensed = gain * current + offset_a + rng.normal(0.0, 0.02 * C_A, n)
    estimator = make_estimator("fused", CELL, 1)
    estimator.start(volts[:1], [30.0], float(sensed[0]), soc=start_soc)
    tracker = OffsetTracker(C_A)
    for k in range(n):
        estimator.step(dt_s if k else 0.0, float(sensed[k]), volts[k : k + 1], np.array([30.0]))
        if tracker.step(dt_s if k else 0.0, float(sensed[k])):
            tracker.compare(*estimator.voltage_soc())
    return tracker.estimate()


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_long_rest_shows_the_offset(sign):
    found = tracked(np.zeros(6 * 360), 10.0, sign * OFFSET_A)
    assert found.is_observed
    assert abs(found.offset_a - sign * OFFSET_A) < 3.0 * found.sigma_a
    assert np.sign(found.offset_a) == sign
    assert found.sigma_a < 0.5 * OFFSET_SIGMA_C * C_A


def test_a_day_of_driving_with_rests_shows_the_offset():
    stint = np.concatenate([np.tile([1.5, -0.5, 0.8, 0.0], 60), np.zeros(420), np.full(60, -0.6)])
    found = tracked(C_A * np.tile(stint * 0.3, 5), 5.0)
    assert abs(found.offset_a - OFFSET_A) < 3.0 * found.sigma_a


def test_half_an_hour_of_driving_shows_nothing_and_says_so():
    found = tracked(C_A * np.tile([2.0, 0.0, 1.0, -0.5], 225), 2.0)
    assert not found.is_observed
    assert found.sigma_a > 0.5 * OFFSET_SIGMA_C * C_A
    assert abs(found.offset_a - OFFSET_A) < 3.0 * found.sigma_a


def test_a_gain_that_errs_is_not_taken_for_an_offset():
    found = tracked(C_A * np.tile([0.5, 0.0], 900), 2.0, 0.0, gain=1.01)
    assert abs(found.offset_a) < 2.0 * found.sigma_a


def test_nothing_seen_is_the_prior():
    found = OffsetTracker(C_A).estimate()
    assert found == (pytest.approx(0.0, abs=1e-12), pytest.approx(OFFSET_SIGMA_C * C_A), False)


def test_a_minute_with_open_relays_shows_even_a_large_offset():
    tracker, offset_a = OffsetTracker(C_A), 0.1 * C_A
    due = [tracker.step(1.0, offset_a, is_open=True) for _ in range(60)]
    assert due[-1]
    assert not any(due[:-1])
    tracker.compare(np.array([0.6]), np.array([0.02]))
    found = tracker.estimate()
    assert found.is_observed
    assert abs(found.offset_a - offset_a) < 3.0 * found.sigma_a


def test_an_interruption_forgets_the_charge_and_keeps_the_offset():
    tracker = OffsetTracker(C_A)
    for _ in range(60):
        tracker.step(1.0, OFFSET_A, is_open=True)
    tracker.compare(np.array([0.8]), np.array([0.005]))
    before = tracker.estimate()
    tracker.interrupt()
    for _ in range(60):
        tracker.step(1.0, OFFSET_A)
    tracker.compare(np.array([0.3]), np.array([0.005]))
    after = tracker.estimate()
    assert after.is_observed
    assert abs(after.offset_a - before.offset_a) < 0.1 * before.sigma_a, "half the charge may have gone unseen"


def test_what_was_seen_long_ago_is_less_sure():
    tracker = OffsetTracker(C_A)
    for _ in range(60):
        tracker.step(1.0, OFFSET_A, is_open=True)
    tracker.compare(np.array([0.8]), np.array([0.01]))
    before = tracker.estimate().sigma_a
    for _ in range(6 * 60):
        tracker.interrupt()
        tracker.step(60.0, OFFSET_A)
        tracker.compare(np.array([0.8]), np.array([0.25]))
    assert tracker.estimate().sigma_a > 1.5 * before
