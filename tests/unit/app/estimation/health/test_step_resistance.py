import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.health.step_resistance import StepResistance

N, DT_S = 12, 0.1


def run(steps, currents_a, resistance_ohm, rng):
    """Feed currents through cells of these resistances, seen through a filter and with noise."""
    seen_v = None
    for current_a in currents_a:
        v = 3.9 - resistance_ohm * current_a
        seen_v = v if seen_v is None else seen_v + 0.6 * (v - seen_v)
        steps.step(DT_S, current_a, seen_v + rng.normal(0, 1e-4, N))


@pytest.mark.parametrize("cell", [0, 7])
def test_one_opening_of_the_relays_shows_a_joint_that_parted(cell):
    steps, rng = StepResistance(N), np.random.default_rng(1)
    run(steps, [100.0] * 10, np.full(N, 2e-3), rng)
    parted = np.where(np.arange(N) == cell, 16e-3, 2e-3)
    run(steps, [100.0] * 10 + [0.0] * 10, parted, rng)
    assert steps.ratio()[cell] == pytest.approx(8.0, rel=0.05)
    others = np.delete(steps.ratio(), cell)
    np.testing.assert_allclose(others, 1.0, atol=0.05)
    assert steps.sigma()[cell] < 0.5


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
