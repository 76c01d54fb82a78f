"""Where modules go, and a string without one."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.season.matching.places import place, without

HEATS = st.lists(st.integers(-50, 50), min_size=1, max_size=5)


@given(HEATS, st.randoms(use_true_random=False))
def test_no_placing_has_a_cooler_hottest_module(heats, random):
    heat = np.array(heats, dtype=float)
    places = np.array([random.randint(-50, 50) for _ in heats], dtype=float)
    found = place(heat, places)
    best = min((heat[list(order)] + places).max() for order in itertools.permutations(range(len(heats))))
    assert found.hottest_k == best
    assert sorted(found.module_at.tolist()) == list(range(len(heats)))


def test_without_the_weakest_module_a_string_gives_what_the_next_holds():
    capacity, resistance = np.linspace(20.0, 25.0, 11), np.full(11, 2e-3)
    resistance[0] = 3e-3
    found = without([0], capacity, np.full(11, 0.05), resistance, 100.0)
    assert found.capacity_ah == pytest.approx(capacity[1], rel=5e-3)
    assert found.capacity_low_ah < capacity[1] < found.capacity_high_ah
    assert found.limiting == 1
    assert found.energy == pytest.approx(capacity[1] * 10 / (capacity[0] * 11), rel=5e-3)
    assert found.energy_low < found.energy < found.energy_high
    assert found.weakest_voltage_v == 0.1


def test_without_a_good_module_only_its_energy_is_lost():
    capacity = np.array([20.0, 24.0, 25.0, np.nan])
    found = without([2], capacity, np.full(4, 1e-6), np.full(4, 2e-3), 100.0)
    assert (found.capacity_ah, found.capacity_now_ah, found.energy) == pytest.approx((20.0, 20.0, 0.75))
    assert found.limiting == 0


@pytest.mark.parametrize("sigma", [0.01, 0.1, 2.0])
def test_the_band_of_what_is_left_holds_the_truth_and_its_own_middle(sigma):
    rng = np.random.default_rng(2)
    held = 0
    for seed in range(40):
        truth = 25.0 + 0.1 * rng.standard_normal(48)
        measured = truth + (0.0 if sigma > 1.0 else sigma * rng.standard_normal(48))
        measured += sigma * rng.standard_normal() if sigma > 1.0 else 0.0  # an error that all share
        found = without([3], measured, np.full(48, sigma), np.full(48, 2e-3), 100.0, seed)
        assert found.capacity_low_ah <= found.capacity_ah <= found.capacity_high_ah
        assert found.energy_low <= found.energy <= found.energy_high
        held += found.capacity_low_ah <= np.delete(truth, 3).min() <= found.capacity_high_ah
    assert held >= 34
