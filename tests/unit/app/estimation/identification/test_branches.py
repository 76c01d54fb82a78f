"""Slow tests taken apart: what was drawn or put in one way, where it rested, and what no hole may hide."""

import numpy as np
import pytest

from app.estimation.errors import ModelError
from app.estimation.identification.branches import find_branches, rest_after, rests_of, stretches
from app.estimation.recording.cell_recording import clean

STEP_S = 60.0
CAPACITY_AH = 3.0


def record(parts, *, gap_after=None, gap_s=0.0, sign=1.0, with_soc=False):
    """A recording of (current [A], steps) parts, with a hole after a row; `sign` turns the voltage round."""
    current = np.concatenate([np.full(steps, float(a)) for a, steps in parts])
    time_s = STEP_S * np.arange(current.size)
    if gap_after is not None:
        time_s[gap_after + 1 :] += gap_s
    soc = 0.9 - np.cumsum(current) * STEP_S / 3600.0 / CAPACITY_AH
    columns = {"time_s": time_s, "current_a": current, "voltage_v": 3.0 + sign * soc}
    return clean("slow.csv", columns | ({"soc": soc} if with_soc else {}))


DOWN, REST, UP = (0.3, 200), (0.0, 30), (-0.3, 150)


def test_a_discharge_and_a_charge_are_two_branches():
    discharges, charges = find_branches([record([REST, DOWN, REST, UP, REST])])
    assert len(discharges) == len(charges) == 1
    assert discharges[0].moved_ah == pytest.approx(0.3 * 200 / 60, rel=0.02)
    assert charges[0].moved_ah == pytest.approx(-0.3 * 150 / 60, rel=0.02)
    assert (discharges[0].current_a, charges[0].current_a) == pytest.approx((0.3, 0.3))
    assert (discharges[0].recording.current_a[discharges[0].rows] > 0.0).all()


def test_rests_between_steps_do_not_part_a_branch():
    discharges, charges = find_branches([record([(0.3, 50), REST, (0.3, 50), REST, (0.3, 50)])])
    assert charges == []
    [branch] = discharges
    assert branch.rows.size == 150
    assert branch.moved_ah == pytest.approx(0.3 * 150 / 60, rel=0.02)


def test_a_short_way_back_is_a_pulse_and_no_turn():
    discharges, charges = find_branches([record([(0.3, 100), (-0.3, 3), (0.3, 100)])])
    assert charges == []
    assert len(discharges) == 1
    assert (discharges[0].recording.current_a[discharges[0].rows] > 0.0).all(), "the pulse is not of the branch"


def test_the_largest_branch_comes_first_and_small_ones_are_none():
    discharges, _ = find_branches([record([(0.3, 80), REST]), record([(0.3, 200), REST]), record([(0.3, 20), REST])])
    moved = [branch.moved_ah for branch in discharges]
    assert moved == sorted(moved, reverse=True)
    assert moved[0] == pytest.approx(1.0, rel=0.02)


def test_a_voltage_against_the_current_is_refused_with_advice():
    with pytest.raises(ModelError, match="--charge-positive"):
        find_branches([record([DOWN, REST], sign=-1.0)])


def test_what_was_drawn_begins_at_none_and_only_grows():
    [branch] = find_branches([record([DOWN, REST])])[0]
    assert branch.drawn_ah[0] == 0.0
    assert (np.diff(branch.drawn_ah) >= 0.0).all()
    assert branch.drawn_ah[-1] == pytest.approx(branch.moved_ah)


@pytest.mark.parametrize("with_soc", [False, True])
def test_a_branch_has_the_soc_of_its_recording_where_that_has_one(with_soc):
    [branch] = find_branches([record([DOWN, REST], with_soc=with_soc)])[0]
    if with_soc:
        assert (np.diff(branch.soc) < 0.0).all()
    else:
        assert branch.soc is None


def test_a_hole_under_current_parts_the_record_and_one_at_rest_does_not():
    loaded = record([DOWN], gap_after=99, gap_s=3600.0)
    assert [rows.size for rows in stretches(loaded)] == [100, 100]
    rested = record([(0.3, 100), (0.0, 20), (0.3, 100)], gap_after=110, gap_s=500.0)
    assert [rows.size for rows in stretches(rested)] == [220]


def test_the_rest_after_a_row_ends_where_current_flows_again():
    recording = record([(0.3, 10), (0.0, 30), (0.3, 10)])
    assert rest_after(recording, 5) == 39
    assert rest_after(recording, 20) == 39, "from within the rest"
    assert rest_after(recording, 45) is None


def test_the_rests_of_a_branch_are_those_that_lasted():
    recording = record([(0.0, 20), (0.3, 50), (0.0, 20), (0.3, 50), (0.0, 5), (0.3, 50), (0.0, 20)])
    [branch] = find_branches([recording])[0]
    assert rests_of(branch).tolist() == [19, 89, 214], "five minutes are no rest"


def test_a_record_of_rest_alone_has_no_branch():
    assert find_branches([record([(0.0, 100)])]) == ([], [])
