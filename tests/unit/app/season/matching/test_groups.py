"""Packs from cells: better than sorting and than chance, the same each time, every cell used once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import ConfigError
from app.season.matching.groups import build_of, match_groups, random_groups, snake, sorted_groups
from tests.campaign import examples


def cells(seed, n):
    rng = np.random.default_rng(seed)
    capacity = 2.5 * (1.0 + 0.01 * rng.standard_normal(n))
    return capacity, 0.02 * (1.0 + 0.05 * rng.standard_normal(n) - 2.0 * (capacity / 2.5 - 1.0))


@pytest.mark.parametrize("seed", [11, 12])
def test_matching_beats_sorting_and_every_random_build(seed):
    capacity, resistance = cells(seed, 96)
    best = match_groups(capacity, resistance, 4)
    for other in (sorted_groups(capacity, resistance, 4), *random_groups(capacity, resistance, 4, builds=50)):
        assert best.cost < other.cost
        assert best.capacity_spread < other.capacity_spread
        assert best.usable >= other.usable


@settings(max_examples=examples(25), deadline=None)
@given(st.integers(1, 6), st.integers(1, 5), st.integers(0, 1000))
def test_every_cell_is_used_once_and_the_figures_are_those_of_the_build(groups, parallel, seed):
    capacity, resistance = cells(seed, groups * parallel)
    build = match_groups(capacity, resistance, parallel)
    assert sorted(build.cells.ravel().tolist()) == list(range(groups * parallel))
    assert build.cells.shape == (groups, parallel)
    assert build.cost <= build_of(snake(capacity, parallel), capacity, resistance).cost + 1e-12
    assert build.usable <= 1.0 + 1e-12
    assert build.share_max >= 1.0 - 1e-12


def test_cells_that_do_not_fill_groups_or_are_no_cells_are_refused():
    capacity, resistance = cells(1, 10)
    with pytest.raises(ConfigError, match="parallel"):
        match_groups(capacity, resistance, 4)
    with pytest.raises(ConfigError, match="resistance_ohm"):
        match_groups(capacity, -resistance, 5)
