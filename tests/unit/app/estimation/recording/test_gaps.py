"""What may have flowed while nothing was measured."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.recording.gaps import Around, GapWatch, bridge_gap
from tests.campaign import of_size


def watched(current_a, dt_s=0.1):
    """Return a watch that has seen these currents."""
    watch = GapWatch()
    assert [watch.step(dt_s, float(i), 40.0) for i in current_a] == [None] * len(current_a)
    return watch


def test_a_short_gap_takes_the_mean_of_its_ends_and_the_spread_of_a_drive():
    gap = bridge_gap(4.0, (100.0, 50.0), Around(10.0, 80.0, 20.0, 60.0), 40.0)
    assert gap.current_a == 75.0
    assert gap.sigma_ah == pytest.approx(80.0 * 4.0 / 3600.0)


def test_a_short_gap_of_many_changes_is_known_better_than_one_change_held():
    assert bridge_gap(40.0, (0.0, 0.0), Around(0.0, 80.0, 20.0, 60.0), 40.0).sigma_ah < 80.0 * 40.0 / 3600.0


@pytest.mark.parametrize(
    ("ends_a", "taken_a"), [((100.0, 5.0), 5.0), ((-3.0, -8.0), -3.0), ((100.0, -20.0), 0.0), ((900.0, 900.0), 0.0)]
)
def test_a_long_gap_takes_the_smaller_end_and_none_where_that_cannot_be(ends_a, taken_a):
    gap = bridge_gap(90.0, ends_a, Around(0.0, 80.0, 20.0, 60.0), 40.0)
    assert gap.current_a == taken_a
    assert gap.sigma_ah == pytest.approx(60.0 * 90.0 / 3600.0)


def test_a_stream_has_no_gap_until_its_step_is_known_nor_where_a_frame_is_missing():
    watch = GapWatch()
    assert watch.step(30.0, 10.0, 40.0) is None
    assert watched(np.zeros(100)).step(0.3, 10.0, 40.0) is None


def test_a_gap_in_a_drive_leaves_the_charge_unsure_and_one_in_a_rest_does_not():
    drive = 60.0 + 50.0 * np.sign(np.sin(np.arange(1200) / 7.0))
    driven, rested = watched(drive), watched(np.zeros(1200))
    gap = driven.step(20.0, 60.0, 40.0)
    assert gap is not None
    assert gap.sigma_ah > 0.05
    assert rested.step(20.0, 0.0, 40.0).sigma_ah == 0.0
    assert driven.usual_step_s == pytest.approx(0.1)


any_current = st.floats(-300.0, 300.0)


@given(st.floats(0.5, 1e5), any_current, any_current, any_current, st.floats(0.0, 200.0), st.floats(0.0, 200.0))
def test_what_is_taken_for_a_gap_lies_between_nothing_and_what_is_around(
    gap_s, before_a, after_a, mean_a, spread_a, usual_a
):
    gap = bridge_gap(gap_s, (before_a, after_a), Around(mean_a, spread_a, spread_a, usual_a), 25.0)
    low, high = min(before_a, after_a, mean_a, 0.0), max(before_a, after_a, mean_a, 0.0)
    assert low - 1e-9 <= gap.current_a <= high + 1e-9
    assert 0.0 <= gap.sigma_ah <= max(1.5 * spread_a, usual_a) * gap_s / 3600.0 + 1e-9
    if gap_s > 60.0:
        assert abs(gap.current_a) * gap_s <= 0.5 * 25.0 * 3600.0


@settings(max_examples=of_size(6, 20, 60), derandomize=True)
@given(st.integers(0, 10**6), st.floats(2.0, 4.0))
def test_the_charge_that_flowed_in_a_gap_of_seconds_is_inside_its_band(seed, gap_s):
    rng = np.random.default_rng(seed)
    drive = np.repeat(rng.choice([-40.0, 0.0, 60.0, 120.0], 900), 20)  # another current every 2 s
    hole = round(gap_s / 0.1)
    watch = watched(drive[:9000])
    gap = watch.step(gap_s, float(drive[9000 + hole]), 25.0)
    assert gap is not None
    flowed_ah = drive[9000 : 9000 + hole].sum() * 0.1 / 3600.0
    assert abs(flowed_ah - gap.current_a * gap_s / 3600.0) < 4.0 * gap.sigma_ah


@given(st.lists(st.floats(0.05, 0.2), min_size=30, max_size=60), any_current)
def test_no_jitter_of_the_steps_is_a_gap(steps_s, current_a):
    watch = GapWatch()
    assert [watch.step(dt_s, current_a, 25.0) for dt_s in steps_s] == [None] * len(steps_s)


def test_measurements_of_one_moment_are_no_step():
    watch = watched(np.full(100, 50.0))
    assert watch.step(0.0, 50.0, 25.0) is None
    assert watch.usual_step_s == pytest.approx(0.1)
    assert watch.is_gap(5.0)
    assert not watch.is_gap(0.1)


def test_a_second_gap_is_judged_by_the_step_before_the_first():
    watch = watched(np.full(100, 50.0))
    assert watch.step(20.0, 50.0, 25.0) is not None
    assert watch.usual_step_s == pytest.approx(0.1)
    assert watch.step(20.0, 50.0, 25.0) is not None


@settings(max_examples=of_size(3, 10, 30), derandomize=True)
@given(st.integers(0, 10**6), st.floats(5.0, 58.0))
def test_the_charge_of_a_gap_of_up_to_a_minute_lies_in_its_band_however_slowly_the_drive_changes(seed, gap_s):
    rng = np.random.default_rng(seed)
    town = rng.choice([-10.0, 0.0, 15.0, 30.0], (12, 30))  # another current every 2 s, another speed every minute
    drive = np.repeat((town * rng.uniform(0.2, 4.0, (12, 1))).ravel(), 20)
    inside = []
    for begin in rng.integers(3000, 6000, 8):
        hole, watch = round(gap_s / 0.1), watched(drive[:begin])
        gap = watch.step(gap_s, float(drive[begin + hole]), 25.0)
        assert gap is not None
        off_ah = drive[begin : begin + hole].sum() * 0.1 / 3600.0 - gap.current_a * gap_s / 3600.0
        inside.append(abs(off_ah) < 3.0 * gap.sigma_ah)
    assert sum(inside) >= 7
