"""Laps of a made-up track: corners and straights as power, driven at paces that differ from lap to lap."""

import numpy as np
import pytest

from app.analysis.laps.detection import Stint, laps_by_marks, laps_by_pattern, rises_s, stints

TRACK = np.random.default_rng(3).uniform(-9e3, 45e3, 40)  # power on each piece of the track


def drive(lap_times_s, *, start_s=0.0, rate_hz=10.0, noise_w=1500.0, seed=1):
    """Return (time, power) of laps in which every piece of the track takes its share of the lap's time."""
    rng = np.random.default_rng(seed)
    ends = start_s + np.cumsum(lap_times_s)
    time_s = np.arange(start_s, ends[-1], 1.0 / rate_hz)
    lap = np.searchsorted(ends, time_s, side="right").clip(0, len(ends) - 1)
    share = (time_s - (ends - lap_times_s)[lap]) / np.asarray(lap_times_s)[lap]
    power_w = TRACK[(share * len(TRACK)).astype(int).clip(0, len(TRACK) - 1)]
    return time_s, power_w + rng.normal(0.0, noise_w, len(time_s))


def join(*stretches):
    return tuple(np.concatenate([stretch[i] for stretch in stretches]) for i in range(2))


def rest(start_s, seconds):
    time_s = np.arange(start_s, start_s + seconds, 0.1)
    return time_s, np.full(len(time_s), 60.0)


@pytest.mark.parametrize("rate_hz", [2.0, 10.0, 28.0])
def test_every_lap_is_found_where_it_was_driven(rate_hz):
    rng = np.random.default_rng(8)
    times_s = 70.0 * (1.0 + rng.normal(0.0, 0.03, 12))
    laps = laps_by_pattern(*drive(times_s, rate_hz=rate_hz))
    assert len(laps) == 12
    np.testing.assert_allclose(np.diff(laps)[1:-1, 0], times_s[1:-1], atol=1.5)
    np.testing.assert_allclose([lap[0] for lap in laps], np.cumsum(times_s) - times_s, atol=2.5)


@pytest.mark.parametrize("share", [0.7, 0.87, 0.95, 0.99])
@pytest.mark.parametrize("stops", [False, True], ids=["the recording ends", "the car stops"])
def test_a_lap_that_was_cut_off_is_partial(share, stops):
    times_s = np.array([80.0, 81, 79, 80, 82])
    time_s, power_w = drive(times_s)
    end_s = times_s[:-1].sum() + share * times_s[-1]
    time_s, power_w = time_s[time_s < end_s], power_w[time_s < end_s]
    if stops:
        time_s, power_w = join((time_s, power_w), rest(end_s, 60))
    *whole, last = laps_by_pattern(time_s, power_w)
    if share > 0.85:
        assert last.is_partial or (stops and share == 0.99)  # the pattern places the line to about a second
    assert not any(lap.is_partial for lap in whole)
    assert min(lap.end_s - lap.start_s for lap in (*whole, last) if not lap.is_partial) > 77.5


def test_a_lap_that_ends_on_the_line_is_whole_where_the_car_then_stops():
    time_s, power_w = join(drive(np.full(4, 80.0)), rest(320.0, 60))
    assert [lap.is_partial for lap in laps_by_pattern(time_s, power_w)] == [False] * 4
    cut = time_s < 325.0  # the recording ends at once: whether the car drove on is not known
    assert [lap.is_partial for lap in laps_by_pattern(time_s[cut], power_w[cut])] == [False] * 3 + [True]


def test_a_lap_is_cut_off_where_the_link_was_lost():
    time_s, power_w = drive(np.full(8, 80.0))
    received = (time_s < 310.0) | (time_s > 400.0)
    found = laps_by_pattern(time_s[received], power_w[received])
    assert [lap.is_partial for lap in found if lap.end_s < 320.0] == [False] * 3 + [True]


def test_a_slow_lap_stays_one_lap():
    times_s = np.array([65.0, 66, 65, 76, 66, 65, 66, 65])
    laps = laps_by_pattern(*drive(times_s))
    np.testing.assert_allclose(np.diff(laps)[:, 0], times_s, atol=1.5)


def test_a_change_of_drivers_ends_one_stint_and_is_no_lap():
    first, second = np.full(5, 80.0), np.full(5, 84.0)
    time_s, power_w = join(drive(first), rest(400.0, 180), drive(second, start_s=580.0), rest(1000.0, 60))
    found = stints(time_s, power_w)
    assert [round(stint.start_s, -1) for stint in found] == [0, 580]
    laps = laps_by_pattern(time_s, power_w)
    assert len(laps) == 10
    np.testing.assert_allclose(np.diff(laps)[5:, 0], second, atol=1.5)
    assert not [lap for lap in laps if lap[0] < 410 and lap[1] > 570]


@pytest.mark.parametrize(
    "recording",
    [
        (np.empty(0), np.empty(0)),
        (np.arange(3.0), np.full(3, np.nan)),
        rest(0.0, 600),
        (np.arange(0, 600, 0.1), np.random.default_rng(1).normal(0, 1e4, 6000)),
        (np.arange(0, 600, 0.1), np.full(6000, 2e4)),
    ],
    ids=["nothing", "not measured", "standing", "no pattern", "steady"],
)
def test_without_laps_none_are_made_up(recording):
    assert laps_by_pattern(*recording) == []


def test_marks_make_laps_but_none_across_a_stop():
    driving = [Stint(0.0, 200.0), Stint(400.0, 600.0)]
    assert laps_by_marks([160.0, 10, 80, 410, 480], driving) == [(10, 80), (80, 160), (410, 480)]
    assert laps_by_marks([10.0, 80, 80, 300], []) == [(10, 80), (80, 300)]
    assert laps_by_marks([5.0], []) == []


def test_a_counter_and_a_beacon_mark_where_they_go_up():
    time_s = np.arange(8.0)
    assert rises_s(time_s, np.array([0, 0, 1, 1, 2, 2, 0, 1])) == [2, 4, 6, 7]  # it wrapped round at 6
    assert rises_s(time_s, np.array([0, 4, 0, 0, 4, 4, 0, 0])) == [
        1,
        4,
    ]
    assert rises_s(time_s[:1], np.array([3])) == []
