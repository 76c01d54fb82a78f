from math import exp, inf, isnan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.health.resistance_tracker import (
    DRIFT_S,
    PAIR_S,
    SAMPLES_MIN,
    SETTLE_S,
    STANDING_S,
    ResistanceTracker,
)
from tests.campaign import examples

R0 = 1.7e-3


def lap(rng, seconds=80.0, dt=0.1):
    current = []
    while len(current) * dt < seconds:
        current += [rng.uniform(60, 220)] * int(rng.uniform(5, 25)) + [-rng.uniform(0, 60)] * int(rng.uniform(5, 20))
        current += [rng.uniform(0, 20)] * int(rng.uniform(3, 15))
    return np.array(current[: int(seconds / dt)])


@pytest.mark.parametrize("seed", [2, 3, 4, 5])
def test_cell_that_comes_back_is_learnt_from_then_on(seed):
    """Whatever current flows when it does: its drift begins where that of a cell like the others would be."""
    rng = np.random.default_rng(seed)
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


def pair_current(current, dt=0.1):
    """Of an RC pair with the tracker's time constant, by its own recursion."""
    pair = [current[0]]
    for i in current[1:]:
        pair.append(pair[-1] + (1.0 - exp(-dt / PAIR_S)) * (i - pair[-1]))
    return np.array(pair)


def driven(tracker, ohmic, pair_ohm=0.0, seconds=160.0, seed=6, noise_v=0.0, level_v=3.8, drift_v_s=0.0):
    """Drive cells whose voltage is exactly what the regression assumes, and noise."""
    rng = np.random.default_rng(seed)
    current = lap(rng, seconds)
    time = 0.1 * np.arange(len(current))
    volts = level_v - drift_v_s * time[:, None] - np.outer(current, ohmic) - np.outer(pair_current(current), pair_ohm)
    tracker.take(np.full(len(current), 0.1), current, volts + noise_v * rng.normal(size=volts.shape))
    return tracker


@settings(max_examples=examples(40), deadline=None)
@given(st.floats(0.3e-3, 30e-3), st.floats(0.1e-3, 10e-3), st.floats(2.0, 4.2))
def test_both_resistances_are_found_whatever_the_voltage_level(ohmic, pair, level_v):
    tracker = driven(ResistanceTracker(3), np.full(3, ohmic), np.full(3, pair), level_v=level_v)
    assert tracker.resistance_ohm()[0] == pytest.approx(ohmic, rel=1e-6)
    assert tracker.resistance_ohm()[1] == pytest.approx(pair, rel=1e-6)


def test_a_slow_fall_of_the_ocv_changes_no_resistance_by_more_than_two_hundredths():
    """A race takes 0.5 V of OCV in half an hour."""
    still = driven(ResistanceTracker(1), np.array([R0])).resistance_ohm()[0, 0]
    falling = driven(ResistanceTracker(1), np.array([R0]), drift_v_s=0.5 / 1800).resistance_ohm()[0, 0]
    assert falling == pytest.approx(still, rel=0.02)


@pytest.mark.parametrize("seconds", [SETTLE_S + 15.0, SETTLE_S + 60.0, 800.0])
def test_sigma_is_as_large_as_the_error_under_noise(seconds):
    """Also soon after a start, where one voltage for the drift of all would leave its noise in every sample."""
    n = 200
    tracker = driven(ResistanceTracker(n), np.full(n, R0), np.full(n, 1e-3), seconds=seconds, noise_v=2e-3)
    error = (tracker.resistance_ohm() - np.array([[R0], [1e-3]])) / tracker.sigma_ohm()
    assert 0.5 < error[0].std() < 1.5
    assert 0.5 < error[1].std() < 1.5


def test_nothing_is_known_before_the_pair_has_settled_and_enough_samples_came():
    tracker = ResistanceTracker(2)
    assert isnan(tracker.excitation_a)
    samples = 0
    while np.isnan(tracker.resistance_ohm()).any():
        current = 100.0 * (samples // 15 % 2)
        tracker.step(0.1, current, np.full(2, 3.8 - R0 * current))
        samples += 1
        assert samples < 1000
    assert 0.1 * samples > SETTLE_S
    assert tracker.learned_s >= 0.1 * (SAMPLES_MIN - 2)
    assert 40.0 < tracker.excitation_a < 100.0, "a current of 0 and 100 A about what it was when the pair had settled"


def test_a_standing_car_teaches_nothing_and_nothing_is_forgotten():
    tracker = driven(ResistanceTracker(2), np.full(2, R0))
    before, learned_s = tracker.resistance_ohm(), tracker.learned_s
    for _ in range(6000):
        tracker.step(0.1, 0.5, np.full(2, 3.8))
    np.testing.assert_allclose(tracker.resistance_ohm(), before, rtol=1e-3, atol=1e-5)
    assert tracker.learned_s - learned_s <= STANDING_S + 0.1
    assert tracker.age_s == pytest.approx(600.0 - (tracker.learned_s - learned_s), abs=0.2)


def test_age_is_infinite_before_the_first_lesson_and_zero_after_one():
    tracker = ResistanceTracker(1)
    tracker.step(0.1, 50.0, np.array([3.7]))
    assert tracker.age_s == inf
    assert driven(ResistanceTracker(1), np.array([R0])).age_s < 5.0


def test_old_samples_fade():
    tracker = driven(ResistanceTracker(1, memory_s=30.0), np.array([R0]))
    driven(tracker, np.array([2 * R0]), seconds=10 * DRIFT_S, seed=7)
    assert tracker.resistance_ohm()[0, 0] == pytest.approx(2 * R0, rel=0.02)


def test_a_tracker_adopts_the_cells_that_it_is_told_and_no_other():
    mine, other = driven(ResistanceTracker(3), np.full(3, R0)), driven(ResistanceTracker(3), np.full(3, 3 * R0))
    mine.adopt(other, np.array([False, True, False]))
    assert mine.resistance_ohm()[0] == pytest.approx([R0, 3 * R0, R0], rel=1e-3)


def test_a_set_resistance_holds_until_the_drive_says_otherwise():
    tracker = driven(ResistanceTracker(3), np.full(3, R0), np.full(3, 1e-3))
    tracker.set_ohmic(np.full(3, 2e-3), np.array([True, False, False]))
    assert tracker.resistance_ohm()[0] == pytest.approx([2e-3, R0, R0], rel=1e-6)
    assert tracker.resistance_ohm()[1] == pytest.approx(1e-3, rel=1e-3)
    driven(tracker, np.full(3, R0), np.full(3, 1e-3), seconds=8 * 60.0, seed=8)
    assert tracker.resistance_ohm()[0] == pytest.approx(R0, rel=0.02)
