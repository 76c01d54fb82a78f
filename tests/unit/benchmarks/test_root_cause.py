"""What the command on causes counts as right, and how it says so."""

from dataclasses import replace

import pytest

from benchmarks.root_cause import FIRST, N_HEALTHY, kept, matrix, misses, summary, text
from benchmarks.root_cause_runs import Case, half_hour
from benchmarks.root_cause_shown import Named, Run, keep_run, kept_run

JOINT = Case("faults", "joint-resistance-high", 1, 60.0, cell=20, pack=1, value=14.0)
NAMED = Named("joint-resistance-high", 20, 1, 14e-3, 13e-3, 15e-3, 66.0)
RIGHT = Run(JOINT, recorded=[NAMED], live=NAMED, alarms=[], page=NAMED, apart=[])
SOUND = Run(Case("healthy", "clean half-hour", 1, 0.0), recorded=[], live=None, alarms=[], page=None, apart=None)


def found(part, *runs):
    """The figures of a part, by name."""
    rows = [line.strip("| ").split(" | ") for line in summary({part: list(runs)}).splitlines()[2:]]
    return {what: figure for what, _, figure in rows}


@pytest.mark.parametrize(
    ("wrong", "recorded", "live"),
    [
        ({}, 2, 2),
        ({"live": replace(NAMED, cell=21)}, 2, 1),
        ({"live": replace(NAMED, code="capacity-low")}, 2, 1),
        ({"recorded": []}, 1, 2),
        ({"recorded": [replace(NAMED, code="unknown"), NAMED]}, 1, 2),
        ({"live": None}, 2, 1),
        ({"live": None, "alarms": [replace(NAMED, cell=21)]}, 2, 1),
        ({"live": None, "alarms": [NAMED]}, 2, 2),
    ],
)
def test_a_cause_is_right_by_its_code_and_cell_live_by_verdict_or_alarm(wrong, recorded, live):
    figures = found("faults", RIGHT, replace(RIGHT, **wrong))
    assert figures["cause of a fault, recorded"].startswith(f"{recorded} of 2 ")
    assert figures["cause of a fault, live"].startswith(f"{live} of 2 ")
    assert (misses([replace(RIGHT, **wrong)]) == "- none") == (recorded == live == 2)


def test_nothing_may_be_named_of_a_sound_car():
    blamed = replace(SOUND, alarms=[Named("capacity-low", 3)]), replace(SOUND, recorded=[Named("external-shutdown")])
    figures = found("healthy", SOUND, replace(SOUND, alarms=[Named("boot")]), *blamed)
    assert figures["half-hour of a sound car, nothing blamed"].startswith("2 of 4 ")


def test_places_agree_where_none_shows_another_and_only_trips_count():
    figures = found("faults", RIGHT, replace(RIGHT, apart=["report"]), replace(RIGHT, live=None, apart=None))
    assert figures["all places agree on a trip"] == "1 of 2"
    assert "apart: report" in misses([replace(RIGHT, apart=["report"])])


def test_a_band_that_misses_its_size_or_is_not_there_does_not_hold_it():
    case = replace(JOINT, part="sizes")
    narrow = Run(case, [NAMED], NAMED, [], replace(NAMED, high=13.9e-3), [])
    figures = found("sizes", replace(narrow, page=NAMED), narrow, replace(narrow, page=None))
    assert figures["band of a joint holds its size"].startswith("1 of 3 ")


def test_the_matrix_counts_each_fault_with_what_was_named():
    rows = matrix([RIGHT, replace(RIGHT, live=replace(NAMED, code="capacity-low"), apart=["cell"])]).splitlines()[2:]
    assert rows == ["| joint-resistance-high | 2 | 2 | 1 | 1 of 2 | joint-resistance-high 1, capacity-low 1 |"]


def test_a_run_is_kept_as_it_was(tmp_path):
    assert kept_run(tmp_path) is None
    for run in (RIGHT, SOUND):
        keep_run(tmp_path, run)
        assert kept_run(tmp_path) == run


def test_a_part_that_was_played_before_is_reported_with_how_much_of_it_is_missing(tmp_path):
    case, _ = half_hour(FIRST + 1)
    run = replace(SOUND, case=case)
    (tmp_path / case.name).mkdir()
    keep_run(tmp_path / case.name, run)
    found = kept("healthy", FIRST, tmp_path)
    assert found == [run]
    assert f"healthy 1 of {N_HEALTHY}, services 0 of" in text({"healthy": found}, FIRST)
