import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.health.joint_watch import StepResistance
from tests.campaign import examples

N, DT_S = 12, 0.1


def run(steps, currents_a, resistance_ohm, rng):
    """Feed currents through cells of these resistances, seen through a filter and with noise."""
    seen_v = None
    for current_a in currents_a:
        v = 3.9 - resistance_ohm * current_a
        seen_v = v if seen_v is None else seen_v + 0.6 * (v - seen_v)
        steps.step(DT_S, current_a, seen_v + rng.normal(0, 1e-4, len(resistance_ohm)))


@given(st.integers(1, 9), st.floats(2e-3, 3e-2))
def test_a_joint_that_parts_within_a_step_is_never_taken_for_a_larger_one(parts_at, joint_ohm):
    """The current rises from 60 to 150 A in a second, and stays; the joint parts on the way."""
    steps, rng = StepResistance(N), np.random.default_rng(1)
    rising_a = np.linspace(60.0, 150.0, 10).tolist()
    run(steps, [60.0] * 10 + rising_a[:parts_at], np.full(N, 2e-3), rng)
    parted = np.where(np.arange(N) == 4, 2e-3 + joint_ohm, 2e-3)
    run(steps, rising_a[parts_at:] + [150.0] * 3, parted, rng)
    assert not steps.ratio()[4] > 1.05 * (1.0 + joint_ohm / 2e-3)
    run(steps, [0.0] * 10, parted, rng)
    assert steps.ratio()[4] == pytest.approx(1.0 + joint_ohm / 2e-3, rel=0.05)


def test_without_a_step_nothing_is_known():
    steps = StepResistance(N)
    run(steps, [50.0] * 100, np.full(N, 2e-3), np.random.default_rng(1))
    assert np.isnan(steps.ratio()).all()


def test_a_missing_voltage_is_not_known_and_spoils_no_other():
    steps, resistance_ohm = StepResistance(N), np.full(N, 2e-3)
    resistance_ohm[3] = np.nan
    run(steps, [100.0] * 10 + [0.0] * 10, resistance_ohm, np.random.default_rng(1))
    assert np.isnan(steps.ratio()[3])
    assert np.isfinite(np.delete(steps.ratio(), 3)).all()


@settings(max_examples=examples(20), deadline=None, derandomize=True)
@given(st.sampled_from([14, 96, 216]), st.floats(0, 1, exclude_max=True), st.floats(2.0, 20.0), st.integers(0, 10**6))
def test_any_joint_that_parted_shows_in_one_step_and_no_other(n, place, times, seed):
    steps, rng, cell = StepResistance(n), np.random.default_rng(seed), int(place * n)
    resistance_ohm = np.full(n, 2e-3)
    resistance_ohm[cell] *= times
    run(steps, [100.0] * 10 + [0.0] * 10, resistance_ohm, rng)
    assert abs(steps.ratio()[cell] - times) < max(4 * steps.sigma()[cell], 0.02 * times)
    np.testing.assert_allclose(np.delete(steps.ratio(), cell), 1.0, atol=0.05)


def test_a_step_that_is_too_small_or_over_a_hole_teaches_nothing():
    small, hole = StepResistance(N), StepResistance(N)
    run(small, [15.0] * 10 + [0.0] * 10, np.full(N, 2e-3), np.random.default_rng(1))
    assert small.learned == 0
    hole.step(0.1, 100.0, np.full(N, 3.7))
    hole.step(5.0, 0.0, np.full(N, 3.9))
    assert hole.learned == 0
    assert np.isnan(hole.ratio()).all()


def test_the_next_step_is_judged_by_itself():
    steps, rng = StepResistance(N), np.random.default_rng(1)
    parted = np.where(np.arange(N) == 3, 16e-3, 2e-3)
    run(steps, [100.0] * 10 + [0.0] * 30, parted, rng)
    assert steps.ratio()[3] > 6.0
    run(steps, [0.0] * 10 + [100.0] * 10, np.full(N, 2e-3), rng)
    assert steps.ratio()[3] == pytest.approx(1.0, abs=0.05)


def test_a_sample_without_a_current_is_passed_over():
    steps, rng = StepResistance(N), np.random.default_rng(1)
    run(steps, [100.0] * 10, np.full(N, 2e-3), rng)
    steps.step(DT_S, float("nan"), np.full(N, 3.0))
    run(steps, [0.0] * 10, np.full(N, 2e-3), rng)
    np.testing.assert_allclose(steps.ratio(), 1.0, atol=0.05)
