"""What a recording's clock may do: every row stays, in its order; what was done is a note with its place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import ImportFailed
from app.sources.recordings.clock import (
    BLOCK,
    LATE_ROWS,
    MOST_FRAMES_PER_S,
    SET_FORWARD_S,
    Clock,
    LogClock,
    own_times,
    rows_in_time,
)
from app.words import Message, render

UNIX_S = 1.784e9


def rows(stamps):
    notes = []
    return rows_in_time("drive.csv", np.asarray(stamps, dtype=float), notes), [render(note) for note in notes]


def frames(stamps):
    return [(float(stamp), 0x100, bytes([k % 256])) for k, stamp in enumerate(stamps)]


def in_time(stamps, **about):
    clock = LogClock()
    for name, value in about.items():
        setattr(clock, name, value)
    found = list(clock.in_time("run.log", frames(stamps)))
    assert [data for *_, data in found] == [data for *_, data in frames(stamps)], "every frame, in its order"
    return [time_s for time_s, *_ in found], [render(note) for note in clock.notes], clock


def test_rows_in_order_stay_as_they_are():
    found, notes = rows(range(20))
    np.testing.assert_array_equal(found.order, range(20))
    np.testing.assert_array_equal(found.time_s, range(20))
    assert (found.started_unix_s, notes) == (None, [])


def test_a_table_with_its_newest_row_first_is_reversed():
    found, notes = rows(range(19, -1, -1))
    np.testing.assert_array_equal(found.order, range(19, -1, -1))
    assert notes == ["the newest row comes first: order reversed"]


def test_a_late_row_is_sorted_to_its_place():
    found, notes = rows([*range(10), 8.5, *range(10, 30)])
    assert found.order[9] == 10
    assert (np.diff(found.time_s) > 0).all()
    assert notes == ["rows sorted by time"]


@pytest.mark.parametrize("begin_s", [0.0, 100.0, UNIX_S])
def test_a_clock_that_starts_again_goes_on_one_step_later(begin_s):
    found, notes = rows([*(begin_s + np.arange(20)), *range(20)])
    np.testing.assert_array_equal(found.time_s, begin_s + np.arange(40))
    assert [note.partition(":")[0] for note in notes] == ["row 21"]


def test_a_clock_set_from_1970_dates_the_rows_before_it():
    found, notes = rows([*range(12, 72), *(UNIX_S + np.arange(140))])
    np.testing.assert_array_equal(np.diff(found.time_s), 1.0)
    assert found.started_unix_s == UNIX_S - 60
    assert notes == ["row 61: the clock is set while logging: the part before it follows without a gap"]


def test_a_gap_of_a_month_stays_a_gap():
    found, notes = rows([0, 1, 2, 30 * 86_400, 30 * 86_400 + 1])
    assert found.time_s[3] == 30 * 86_400
    assert notes == []


def test_a_time_of_day_goes_on_past_midnight():
    found, notes = rows([86_390, 86_395, 5, 10, 15, 20, 25, 30])
    np.testing.assert_array_equal(np.diff(found.time_s), [5, 10, 5, 5, 5, 5, 5])
    assert notes == ["row 3: the time of day passes midnight: counted on"]


def test_rows_without_a_time_are_counted():
    found, notes = rows([0, np.nan, 2, 3])
    np.testing.assert_array_equal(found.order, [0, 2, 3])
    assert notes == ["1 of 4 rows have no time: left out"]


@pytest.mark.parametrize("stamps", [[np.nan] * 3, [0, 5, 1, 6, 2, 7, 3, 8, 4, 9] * 2])
def test_what_is_no_time_is_refused_by_the_name_of_the_file(stamps):
    with pytest.raises(ImportFailed, match=r"drive\.csv"):
        rows(stamps)


def test_rows_of_one_stamp_stay_as_the_two_sides_of_a_step():
    notes = []
    found = own_times(np.array([0.0, 30.0, 30.0, 60.0, 90.0]), notes)
    assert (np.diff(found) > 0).all()
    np.testing.assert_allclose(found, [0, 30, 30, 60, 90], atol=1e-5)
    assert [render(note) for note in notes] == ["1 rows have the time of the row before: kept, in their order"]


def test_rows_of_a_clock_in_steps_are_spread_over_each_step_and_a_hole_stays():
    found = own_times(np.repeat([0.0, 1.0, 10.0, 11.0], 4), [])
    np.testing.assert_allclose(found[4:9], [1.0, 1.25, 1.5, 1.75, 10.0])


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(min_value=-1e9, max_value=4e9, allow_nan=False, allow_infinity=False), min_size=1, max_size=60),
    st.integers(1, 60),
)
def test_blocks_give_the_times_of_the_whole(stamps, size):
    stamps = np.array(stamps)
    whole = Clock(lambda n: Message("row-n", n=n))
    parts = Clock(lambda n: Message("row-n", n=n))
    expected = whole.times_s(stamps)
    found = [
        parts.times_s(stamps[k : k + size], stamps[k + size : k + size + LATE_ROWS])
        for k in range(0, len(stamps), size)
    ]
    changes = [note.args["place"].args["n"] for note in whole.notes]
    assert [note.args["place"].args["n"] for note in parts.notes] == changes
    if not changes:
        np.testing.assert_array_equal(np.concatenate(found), expected)


def test_a_log_whose_clock_is_put_back_names_the_line():
    clock = LogClock()
    clock.has_lines, clock.lines_left_out = True, [0, 0]
    found = [time_s for time_s, *_ in clock.in_time("run.log", frames([*range(10, 20), *range(10)]))]
    np.testing.assert_array_equal(np.diff(found), 1.0)
    assert [render(note) for note in clock.notes] == [
        "line 13: the clock goes back by 19 s: the parts follow one another"
    ]


def test_frames_of_several_buses_keep_their_times_though_some_are_late():
    stamps = UNIX_S + np.arange(200) * 0.01 - np.arange(200) % 3 * 0.4
    found, notes, clock = in_time(stamps)
    np.testing.assert_array_equal(found, stamps)
    assert notes == []
    assert clock.started_unix_s(found[0]) == stamps[0]


def test_differences_are_added_up_only_where_the_format_has_them():
    stamps = np.tile([0.002, 0.098], 100)
    stamps[0] = 0.0
    found, notes, _ = in_time(stamps, may_be_differences=True)
    np.testing.assert_allclose(np.diff(found), stamps[1:])
    assert notes == ["the stamps are differences (`candump -td`): added up"]
    assert in_time(stamps)[1] == []


def test_a_step_back_in_a_later_block_is_found_and_its_time_goes_on():
    n = 2 * BLOCK + 100
    stamps = np.arange(n) * 0.01
    stamps[BLOCK + 50 :] -= 100.0
    found, notes, _ = in_time(stamps)
    np.testing.assert_allclose(np.diff(found), 0.01, atol=1e-6)
    assert len(notes) == 1


def test_more_frames_than_fit_on_a_bus_are_refused():
    with pytest.raises(ImportFailed, match="fit on no bus"):
        in_time(np.arange(3000) / (1.1 * MOST_FRAMES_PER_S))
    in_time(np.arange(3000) / (0.9 * MOST_FRAMES_PER_S))


def test_a_clock_set_forward_by_years_makes_no_years():
    found, notes, clock = in_time([*(9.47e8 + np.arange(50)), *(9.47e8 + SET_FORWARD_S * 20 + np.arange(50))])
    assert found[-1] - found[0] == 99
    assert len(notes) == 1
    assert clock.started_unix_s(found[0]) == 9.47e8 + SET_FORWARD_S * 20 - 50
