import numpy as np
import pytest

from app.estimation.errors import ModelError, ShapeError
from app.estimation.health.capacity import CapacityTracker, state_of_health

NOMINAL = 25.0


def sessions(tracker, true_ah, seed=0, n=40, soc_sigma=0.01, charge_sigma=0.1):
    rng = np.random.default_rng(seed)
    for _ in range(n):
        moved = rng.uniform(0.3, 0.8, true_ah.size) * rng.choice([-1.0, 1.0])
        tracker.observe(
            moved + soc_sigma * rng.normal(size=true_ah.size),
            soc_sigma,
            moved * true_ah + charge_sigma * rng.normal(size=true_ah.size),
            charge_sigma,
        )


def test_new_tracker_believes_the_nominal_capacity_loosely():
    tracker = CapacityTracker(NOMINAL, 3)
    np.testing.assert_allclose(tracker.capacity_ah(), NOMINAL, rtol=1e-6)
    assert (tracker.sigma_ah() > 0.03 * NOMINAL).all()


def test_true_capacities_are_found_over_sessions_of_both_signs():
    true_ah = np.linspace(20.0, 25.5, 96)
    tracker = CapacityTracker(NOMINAL, 96)
    sessions(tracker, true_ah)
    error = tracker.capacity_ah() - true_ah
    assert np.abs(error).max() < 0.4
    assert abs(error.mean()) < 0.05


def test_sigma_tells_the_truth():
    true_ah = np.full(400, 23.0)
    tracker = CapacityTracker(NOMINAL, 400)
    sessions(tracker, true_ah, n=15)
    nees = ((tracker.capacity_ah() - true_ah) / tracker.sigma_ah()) ** 2
    assert 0.6 < nees.mean() < 1.6
    assert tracker.sigma_ah().mean() < 0.01 * NOMINAL


def test_noisy_soc_does_not_pull_the_capacity_down_as_a_plain_regression_does():
    rng = np.random.default_rng(3)
    true_ah, soc_noise, charge_noise = 25.0, 0.08, 0.8
    x = rng.uniform(0.3, 0.6, (60, 300))
    seen = x + soc_noise * rng.normal(size=x.shape)
    counted = x * true_ah + charge_noise * rng.normal(size=x.shape)
    tracker = CapacityTracker(NOMINAL, 300)
    for soc_moved, charge_ah in zip(seen, counted, strict=True):
        tracker.observe(soc_moved, soc_noise, charge_ah, charge_noise)
    plain = (seen * counted).sum() / (seen**2).sum()
    assert plain < 0.98 * true_ah
    assert abs(tracker.capacity_ah().mean() - true_ah) < 0.3 * abs(plain - true_ah)


def test_ageing_is_followed():
    tracker = CapacityTracker(NOMINAL, 50)
    sessions(tracker, np.full(50, 25.0), n=60)
    sessions(tracker, np.full(50, 22.0), seed=1, n=150)
    np.testing.assert_allclose(tracker.capacity_ah(), 22.0, atol=0.4)


def test_small_moves_and_missing_cells_change_nothing():
    tracker = CapacityTracker(NOMINAL, 2)
    before = tracker.state
    tracker.observe([0.05, np.nan], 0.01, [1.0, 5.0], 0.1)
    np.testing.assert_array_equal(tracker.state, before)


def test_stored_state_goes_on_where_it_stopped():
    true_ah = np.array([22.0, 24.0])
    whole, first = CapacityTracker(NOMINAL, 2), CapacityTracker(NOMINAL, 2)
    for tracker in (whole, first):
        sessions(tracker, true_ah, n=5)
    second = CapacityTracker(NOMINAL, 2, first.state)
    for tracker in (whole, second):
        sessions(tracker, true_ah, seed=9, n=5)
    np.testing.assert_array_equal(whole.capacity_ah(), second.capacity_ah())


def test_errors_that_cannot_be_are_refused():
    tracker = CapacityTracker(NOMINAL, 2)
    with pytest.raises(ModelError):
        tracker.observe(0.5, 0.0, 12.0, 0.1)
    with pytest.raises(ModelError):
        CapacityTracker(-1.0, 2)
    with pytest.raises(ShapeError):
        CapacityTracker(NOMINAL, 3, tracker.state)


def test_health_against_new():
    health = state_of_health(np.array([25.0, 20.0]), np.array([0.25, 0.5]), 25.0, np.array([1.0, 1.5]))
    np.testing.assert_allclose(health.capacity, [1.0, 0.8])
    np.testing.assert_allclose(health.capacity_sigma, [0.01, 0.02])
    np.testing.assert_allclose(health.resistance, [1.0, 0.5])
