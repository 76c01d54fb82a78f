"""Each row of a recording gets a stamp of its own: repeats, the two rows of a step, coarse clocks."""

import numpy as np
import pytest

from app.estimation.errors import DatasetError
from app.estimation.recording.time_axis import usual_step, without_repeats


def table(times, currents=None):
    times = np.asarray(times, dtype=float)
    current = np.arange(times.size, dtype=float) if currents is None else np.asarray(currents, dtype=float)
    return np.column_stack((times, current, 3.7 + 0.001 * current))


def spread(times, currents=None):
    notes = []
    return without_repeats("drive.csv", table(times, currents), notes), notes


@pytest.mark.parametrize(
    ("times", "step"),
    [([0, 1, 2, 3], 1.0), ([0, 0, 0.5, 0.5, 1.0], 0.5), ([0, 1, 2, 100], 1.0), ([7], 1.0), ([3, 3], 1.0)],
)
def test_the_usual_step_is_the_median_of_those_that_are_steps(times, step):
    assert usual_step(np.array(times, dtype=float)) == step


def test_stamps_of_their_own_are_left_alone():
    rows, notes = spread(range(10))
    np.testing.assert_array_equal(rows, table(range(10)))
    assert notes == []


def test_an_exact_repeat_is_left_out():
    rows, notes = spread([0, 1, 1, 2, 3, 4], [0, 5, 5, 6, 7, 8])
    np.testing.assert_array_equal(rows[:, 0], [0, 1, 2, 3, 4])
    np.testing.assert_array_equal(rows[:, 1], [0, 5, 6, 7, 8])
    assert notes == ["1 rows with the stamp of another left out"]


def test_a_step_keeps_the_row_before_and_the_row_after_it():
    rows, notes = spread([0, 1, 1, 2, 3, 4], [0, 0, 50, 50, 50, 50])
    np.testing.assert_array_equal(rows[:, 1], [0, 0, 50, 50, 50, 50])
    assert notes == ["1 stamps occur twice with different values: kept as before and after a step"]


def test_of_three_rows_with_one_stamp_the_first_and_the_last_count():
    rows, _ = spread([0, 1, 1, 1, 2, 3, 4], [0, 0, 20, 50, 50, 50, 50])
    np.testing.assert_array_equal(rows[:, 1], [0, 0, 50, 50, 50, 50])


def test_the_rows_of_a_coarse_clock_are_spread_over_its_step():
    rows, notes = spread(np.repeat([0.0, 1.0, 2.0], 4))
    np.testing.assert_allclose(rows[:, 0], np.arange(12) / 4)
    np.testing.assert_array_equal(rows[:, 1], np.arange(12))
    assert notes == ["the clock counts in steps of 1 s: rows within a step spread evenly"]


def test_a_hole_in_a_coarse_clock_stays_a_hole():
    rows, _ = spread(np.repeat([0.0, 1.0, 10.0, 11.0], 4))
    np.testing.assert_allclose(rows[4:8, 0], [1.0, 1.25, 1.5, 1.75])
    assert rows[8, 0] == 10.0


def test_a_clock_that_stands_still_is_refused_with_advice():
    with pytest.raises(DatasetError, match="--period SECONDS"):
        spread([5.0] * 8)


def test_the_input_is_not_changed():
    given = table(np.repeat([0.0, 1.0, 2.0], 4))
    before = given.copy()
    without_repeats("drive.csv", given, [])
    np.testing.assert_array_equal(given, before)
