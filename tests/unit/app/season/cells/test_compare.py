"""Two groups of sessions: differences are judged by the spread between sessions."""

import numpy as np
import pytest

from app.season.cells.compare import compare
from tests.unit.app.season.season_of import history


def seasons(seed, change=0.0, cell_change=0.0, n=16, car="red"):
    rng = np.random.default_rng(seed)
    values = 1.0 + 0.01 * rng.standard_normal((n, 12)) + 0.02 * rng.standard_normal((n, 1))
    values[n // 2 :] += change
    values[n // 2 :, 3] += cell_change
    made = history(values, np.full(values.shape, 0.01), car=car)
    half = n // 2
    return made, set(made.sessions[:half]), set(made.sessions[half:])


def figure(found, name):
    return next(each for each in found.differences if each.name == name)


def compared(history, a, b):
    (found,) = compare([history], a, b)
    return found


def test_the_band_of_a_difference_holds_the_truth_as_often_as_it_says():
    inside = 0
    for seed in range(200):
        each = figure(compared(*seasons(seed, change=0.05)), "resistance")
        inside += each.low <= 0.05 <= each.high
    assert inside >= 180  # 190 are expected


def test_sessions_that_differ_by_themselves_make_no_difference_sure():
    sure = sum(figure(compared(*seasons(seed)), "resistance").is_sure for seed in range(100))
    assert sure <= 12


def test_a_cell_that_changed_is_named_and_no_other():
    cells = compared(*seasons(1, cell_change=0.06)).cells
    assert [each.cell for each in cells] == [3]
    assert cells[0].low <= 0.06 <= cells[0].high


def test_a_group_of_one_session_says_no_difference():
    made, a, _ = seasons(2)
    found = compared(made, a, {made.sessions[-1]})
    assert figure(found, "resistance").change is None
    assert figure(found, "resistance").b == pytest.approx(1.0, abs=0.1)
    assert (found.sessions_a, found.sessions_b, found.cells) == (8, 1, [])


def test_few_sessions_make_no_cell_sure_by_chance():
    named = sum(bool(compared(*seasons(seed, n=4)).cells) for seed in range(200))
    assert named <= 20  # 10 are expected at most


def test_a_swapped_module_is_no_cell_that_changed():
    made, a, b = seasons(1, cell_change=0.06)
    made.is_present[:8, 3] = False
    assert compared(made, a, b).cells == []


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
        each = figure(compared(*discharging(seed, change=5e-4)), "self_discharge")
        inside += each.low <= 5e-4 <= each.high
        assert (each.unit, each.n_a, each.n_b) == ("1/d", 11, 11)  # the pause between the groups is nobody's
    assert inside >= 88  # 95 are expected


def test_two_cars_are_compared_as_accumulators_and_never_cell_by_cell():
    red, blue = seasons(1)[0], seasons(2, change=0.1, cell_change=0.1, car="blue")[0]
    (found,) = compare([blue, red], {*red.sessions}, {*blue.sessions[8:]})
    assert (found.car_a, found.car_b, found.sessions_a, found.sessions_b) == ("red", "blue", 16, 8)
    each = figure(found, "resistance")
    assert each.is_sure
    assert each.low <= 0.1 <= each.high
    assert found.cells == []


def test_groups_of_two_cars_are_compared_car_by_car():
    """Else what one car has more than the other would be a change of a cell, or hide one."""
    (red, *of_red), (blue, *of_blue) = seasons(1), seasons(2, cell_change=0.06, car="blue")
    a, b = (of_red[k] | of_blue[k] for k in (0, 1))
    found = compare([blue, red], a, b)
    assert [(each.car_a, each.car_b, each.sessions_a, each.sessions_b) for each in found] == [
        ("blue", "blue", 8, 8),
        ("red", "red", 8, 8),
    ]
    assert [[cell.cell for cell in each.cells] for each in found] == [[3], []]
    assert found == compare([blue], *of_blue) + compare([red], *of_red)


def test_a_car_of_one_group_alone_has_nothing_to_be_compared_with():
    (red, *of_red), blue = seasons(1), seasons(2, car="blue")[0]
    alone, both = compare([blue, red], of_red[0] | {*blue.sessions}, of_red[1])
    assert (alone.sessions_a, alone.sessions_b, figure(alone, "resistance").change) == (16, 0, None)
    assert both == compare([red], *of_red)[0]
    assert compare([red], {"none"}, set()) == []
