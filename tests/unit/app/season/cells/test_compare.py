"""Two groups of sessions: differences are judged by the spread between sessions."""

from dataclasses import replace

import numpy as np
import pytest

from app.season.cells.compare import compare
from tests.unit.app.season.season_of import history


def seasons(seed, change=0.0, cell_change=0.0, n=16):
    rng = np.random.default_rng(seed)
    values = 1.0 + 0.01 * rng.standard_normal((n, 12)) + 0.02 * rng.standard_normal((n, 1))
    values[n // 2 :] += change
    values[n // 2 :, 3] += cell_change
    made = history(values, np.full(values.shape, 0.01))
    half = n // 2
    return made, set(made.sessions[:half]), set(made.sessions[half:])


def figure(found, name):
    return next(each for each in found if each.name == name)


def test_the_band_of_a_difference_holds_the_truth_as_often_as_it_says():
    inside = 0
    for seed in range(200):
        each = figure(compare(*seasons(seed, change=0.05))[0], "resistance")
        inside += each.low <= 0.05 <= each.high
    assert inside >= 180  # 190 are expected


def test_sessions_that_differ_by_themselves_make_no_difference_sure():
    sure = sum(figure(compare(*seasons(seed))[0], "resistance").is_sure for seed in range(100))
    assert sure <= 12


def test_a_cell_that_changed_is_named_and_no_other():
    _, cells = compare(*seasons(1, cell_change=0.06))
    assert [each.cell for each in cells] == [3]
    assert cells[0].low <= 0.06 <= cells[0].high


def test_a_group_of_one_session_says_no_difference():
    made, a, _ = seasons(2)
    found, cells = compare(made, a, {made.sessions[-1]})
    assert figure(found, "resistance").change is None
    assert figure(found, "resistance").b == pytest.approx(1.0, abs=0.1)
    assert cells == []


def test_few_sessions_make_no_cell_sure_by_chance():
    named = sum(bool(compare(*seasons(seed, n=4))[1]) for seed in range(200))
    assert named <= 20  # 10 are expected at most


def test_a_swapped_module_is_no_cell_that_changed():
    made, a, b = seasons(1, cell_change=0.06)
    made.is_present[:8, 3] = False
    assert compare(made, a, b)[1] == []


def discharging(seed, change=0.0, n=24):
    """Sessions a week apart; each pause loses 0.02 % a day, 0.02 % more or less by chance."""
    rng = np.random.default_rng(seed)
    lost = 2e-4 + 2e-4 * rng.standard_normal((n, 1)) + 1e-4 * rng.standard_normal((n, 12))
    lost[n // 2 :] += change
    lost[0] = np.nan
    made = history(np.ones((n, 12)), np.full((n, 12), 0.01), lost=lost)
    return made, set(made.sessions[: n // 2]), set(made.sessions[n // 2 :])


def test_self_discharge_is_compared_with_its_band():
    inside = 0
    for seed in range(100):
        each = figure(compare(*discharging(seed, change=5e-4))[0], "self_discharge")
        inside += each.low <= 5e-4 <= each.high
        assert (each.unit, each.n_a, each.n_b) == ("1/d", 11, 11)  # the pause between the groups is nobody's
    assert inside >= 88  # 95 are expected


def test_a_pause_belongs_to_the_car_that_stood():
    made, a, b = discharging(1)
    cars = tuple("red" if k % 2 else "blue" for k in range(len(made.sessions)))
    each = figure(compare(replace(made, cars=cars), a, b)[0], "self_discharge")
    assert (each.n_a, each.n_b) == (11, 10)  # of the first car, nothing is known of the first pause of all
