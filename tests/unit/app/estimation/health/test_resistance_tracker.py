import numpy as np
import pytest

from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.health.resistance_tracker import ResistanceTracker

R0 = 1.7e-3


def lap(rng, seconds=80.0, dt=0.1):
    current = []
    while len(current) * dt < seconds:
        current += [rng.uniform(60, 220)] * int(rng.uniform(5, 25)) + [-rng.uniform(0, 60)] * int(rng.uniform(5, 20))
        current += [rng.uniform(0, 20)] * int(rng.uniform(3, 15))
    return np.array(current[: int(seconds / dt)])


def test_cell_that_comes_back_is_learnt_from_then_on():
    rng = np.random.default_rng(2)
    tracker = ResistanceTracker(12)
    current = lap(rng, 160.0)
    for k, i in enumerate(current):
        v = np.full(12, 3.8 - R0 * i)
        if k < len(current) // 2:
            v[3] = np.nan
        tracker.step(0.1, i, v)
    assert tracker.resistance_ohm()[0, 3] == pytest.approx(R0, rel=5e-3)


def test_hole_in_the_stream_says_nothing():
    tracker = ResistanceTracker(2)
    for k in range(600):
        tracker.step(0.1, 100.0 * (k // 20 % 2), np.full(2, 3.8 - R0 * 100.0 * (k // 20 % 2)))
    before = tracker.resistance_ohm()
    assert np.isfinite(before).all()
    tracker.step(500.0, 300.0, np.full(2, 2.0))
    np.testing.assert_array_equal(tracker.resistance_ohm(), before)


@pytest.mark.parametrize("memory_s", [60.0, 1e9])
def test_many_samples_at_once_are_the_same_as_one_by_one(memory_s):
    """Also across holes, missing cells, a missing current, and samples at uneven times."""
    rng = np.random.default_rng(4)
    n, n_cells = 3000, 7
    current = np.concatenate([lap(rng) for _ in range(4)])[:n]
    dt = rng.uniform(0.05, 0.15, n)
    volts = 3.8 - np.outer(current, np.linspace(1e-3, 2e-3, n_cells)) + 1e-3 * rng.normal(size=(n, n_cells))
    volts[400:420, 2] = np.nan
    volts[:900, 5] = np.nan
    volts[rng.integers(0, n, 10), rng.integers(0, n_cells, 10)] = np.nan
    current[1200] = np.nan
    dt[1800] = 5.0
    dt[2000] = 0.0
    one_by_one, at_once = (ResistanceTracker(n_cells, memory_s=memory_s) for _ in range(2))
    for step_s, amperes, row in zip(dt, current, volts, strict=True):
        one_by_one.step(float(step_s), float(amperes), row)
    for first in range(0, n, 850):
        piece = slice(first, first + 850)
        at_once.take(dt[piece], current[piece], volts[piece])
    np.testing.assert_allclose(at_once.resistance_ohm(), one_by_one.resistance_ohm(), rtol=1e-9)
    np.testing.assert_allclose(at_once.sigma_ohm(), one_by_one.sigma_ohm(), rtol=1e-6)
    assert np.isfinite(at_once.resistance_ohm()).all()


def test_many_samples_of_the_wrong_shape_are_refused():
    tracker = ResistanceTracker(4)
    with pytest.raises(ShapeError, match="voltages_v"):
        tracker.take(np.ones(3), np.ones(3), np.ones((3, 5)))
    with pytest.raises(EstimatorError, match="dt_s"):
        tracker.take(np.array([0.1, -0.1]), np.ones(2), np.ones((2, 4)))


def test_broken_samples_are_refused():
    tracker = ResistanceTracker(4)
    with pytest.raises(ShapeError):
        tracker.step(0.1, 1.0, np.zeros(3))
    with pytest.raises(EstimatorError):
        tracker.step(-1.0, 1.0, np.zeros(4))
