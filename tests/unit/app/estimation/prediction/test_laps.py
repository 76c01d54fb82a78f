"""Laps known by marks and by the period of the power: when there is a number, and when there is none."""

import numpy as np
import pytest

from app.estimation.prediction.laps import LapWatch, lap_period_s
from simulator.loads import Phase
from simulator.race import Driver, endurance

STEP_S = 0.1


def lap_power(period_s, seed):
    rng = np.random.default_rng(seed)
    return np.convolve(rng.choice([0.0, 5e3, 25e3, 60e3, -8e3], int(period_s)), np.ones(3) / 3, "same")


def course(period_s, n_laps, seed=0, jitter=0.005):
    """Return the power [W] every STEP_S of laps that differ a little."""
    rng = np.random.default_rng(seed)
    shape = lap_power(period_s, seed)
    parts = []
    for _ in range(n_laps):
        length = int(period_s * (1 + jitter * rng.normal()) / STEP_S)
        place = np.linspace(0, shape.size - 1, length)
        parts.append(np.interp(place, np.arange(shape.size), shape) * rng.normal(1, 0.02))
    power = np.concatenate(parts)
    return power + 500 * rng.normal(size=power.size)


def follow(watch, power_w):
    """Feed the power and return what was known after every 2.5 s."""
    known = []
    for k, watts in enumerate(power_w):
        watch.step(STEP_S, float(watts))
        if k % 25 == 24:
            watch.judge()
            known.append(watch.laps)
    return known


def stand(watch, seconds):
    return follow(watch, np.zeros(round(seconds / STEP_S)))


@pytest.mark.parametrize("period_s", [45, 71, 120])
def test_the_period_is_found_in_the_power(period_s):
    power = course(period_s, 8, seed=period_s)
    assert lap_period_s(np.arange(power.size) * STEP_S, power) == pytest.approx(period_s, rel=0.03)


def test_power_that_does_not_repeat_has_no_laps():
    rng = np.random.default_rng(1)
    time_s, power = np.arange(6000) / 10.0, np.convolve(rng.normal(size=6000), np.ones(20) / 20, "same") * 1e4
    assert lap_period_s(time_s, power) is None
    assert lap_period_s(time_s, np.full(6000, 5e3)) is None
    assert lap_period_s(np.array([0.0]), np.array([1.0])) is None
    assert not any(follow(LapWatch(), power))


def test_no_number_before_two_whole_laps():
    watch, power = LapWatch(), course(60, 8, seed=3)
    known = follow(watch, power)
    first = next(k for k, laps in enumerate(known) if laps is not None)
    assert 2 * 60 < first * 2.5 < 5 * 60
    assert known[-1].period_s == pytest.approx(60, rel=0.03)
    assert known[-1].energies_wh == pytest.approx(np.full(7, lap_power(60, 3).mean() * 60 / 3600), rel=0.1)
    assert 0.5 < known[-1].confidence <= 1.0


def test_two_marked_laps_are_enough():
    watch = LapWatch()
    for n_marks in range(3):
        assert watch.laps is None
        watch.mark()
        if n_marks < 2:
            follow(watch, np.full(500, 36e3))
    watch.judge()
    assert watch.laps.source == "marks"
    assert watch.laps.period_s == pytest.approx(50.0)
    np.testing.assert_allclose(watch.laps.energies_wh, 36e3 * 50 / 3600, rtol=0.01)


def test_a_mark_may_be_set_late():
    watch = LapWatch()
    for ago_s in (0.0, 4.0, 0.0):
        watch.mark(ago_s)
        follow(watch, np.full(500, 36e3))
    watch.judge()
    assert watch.laps.period_s == pytest.approx(50.0, abs=0.1)
    np.testing.assert_allclose(watch.laps.energies_wh, [36e3 * 46 / 3600, 36e3 * 54 / 3600], rtol=0.01)


def test_a_marked_lap_with_a_stop_is_none():
    watch = LapWatch()
    watch.mark()
    follow(watch, np.full(500, 36e3))
    watch.mark()
    stand(watch, 60)
    follow(watch, np.full(500, 36e3))
    watch.mark()
    watch.judge()
    assert watch.laps is None


def test_no_lap_for_three_lap_times_ends_it():
    watch = LapWatch()
    follow(watch, course(60, 7, seed=3))
    assert watch.laps is not None
    standing = stand(watch, 300)
    assert standing[0] is not None
    lasted_s = 2.5 * sum(laps is not None for laps in standing)
    assert lasted_s == pytest.approx(3 * 60, abs=20)
    assert watch.is_overdue


def test_the_same_course_is_known_again_after_a_lap_and_another_is_not():
    watch = LapWatch()
    follow(watch, course(60, 7, seed=3))
    stand(watch, 300)
    again = follow(watch, course(60, 3, seed=3))
    first = next(k for k, laps in enumerate(again) if laps is not None)
    assert 50 < first * 2.5 < 130
    stand(watch, 300)
    other = follow(watch, course(97, 3, seed=8))
    assert not any(laps is not None and abs(laps.period_s - 60) < 5 for laps in other[-40:])


@pytest.mark.parametrize("seed", range(220, 232))  # none of them took part in choosing the thresholds
def test_races_are_never_counted_by_another_period_than_the_lap(seed):
    driver = Driver(lap_spread=(0.005, 0.01, 0.02, 0.04)[seed % 4])
    race = endurance(np.random.default_rng(seed), driver=driver, n_laps=8, change_s=60)
    power_w = race.power_w[: len(race.power_w) // 2 * 2].reshape(-1, 2).mean(axis=1)
    states = [race.state(k * STEP_S) for k in range(len(power_w))]
    first_s = next(k for k, state in enumerate(states) if state.phase == Phase.DRIVING) * STEP_S
    second_s = next(k for k, state in enumerate(states) if state.lap == 2) * STEP_S
    third_s = next(k for k, state in enumerate(states) if state.lap == 3) * STEP_S
    known = follow(LapWatch(), power_w)
    shown = [(2.5 * (k + 1), laps) for k, laps in enumerate(known) if laps is not None]
    assert shown or driver.lap_spread == 0.04
    assert all(at_s - first_s > 2 * (third_s - second_s) for at_s, _ in shown)
    np.testing.assert_allclose([laps.period_s for _, laps in shown], third_s - second_s, rtol=0.08)


def test_a_hole_in_the_data_is_not_driven():
    watch = LapWatch()
    follow(watch, course(60, 7, seed=3))
    energy_wh = watch.laps.energies_wh.sum()
    watch.step(100.0, 5e4)
    watch.judge()
    assert watch.laps.energies_wh.sum() == pytest.approx(energy_wh, rel=0.01)


def test_what_was_driven_is_counted_and_standing_is_not():
    watch = LapWatch()
    follow(watch, np.full(600, 36e3))
    assert watch.now == pytest.approx((60.0, 600.0), rel=1e-6)
    stand(watch, 120)
    driven_s, energy_wh = watch.now
    assert driven_s == pytest.approx(60.0 + 15.0, abs=0.2), "a car stands once it has for 15 s"
    assert energy_wh == pytest.approx(600.0, rel=1e-6)


def test_braking_gives_energy_back():
    watch = LapWatch()
    follow(watch, np.full(600, 36e3))
    follow(watch, np.full(300, -12e3))
    assert watch.now[1] == pytest.approx(600.0 - 100.0, rel=1e-6)


def test_the_energy_at_a_time_driven_lies_on_the_way():
    watch = LapWatch()
    follow(watch, np.full(600, 36e3))
    follow(watch, np.full(600, 72e3))
    assert watch.energy_at(0.0) == 0.0
    assert watch.energy_at(30.0) == pytest.approx(300.0, rel=0.01)
    assert watch.energy_at(90.0) == pytest.approx(600.0 + 600.0, rel=0.01)
    assert watch.energy_at(1e6) == watch.now[1]


def test_the_oldest_energy_stands_for_what_is_older_than_ten_minutes():
    watch = LapWatch()
    follow(watch, np.full(9000, 36e3))
    assert watch.energy_at(0.0) == pytest.approx(watch.energy_at(299.0), rel=0.01)
    assert watch.energy_at(600.0) == pytest.approx(6000.0, rel=0.01)


def test_the_last_mark_says_how_many_there_were_and_where_the_line_is():
    watch = LapWatch()
    assert watch.last_mark == (0, None)
    for lap in range(1, 21):
        follow(watch, np.full(400, 36e3))
        watch.mark()
        assert watch.last_mark == (lap, pytest.approx((40.0 * lap, 400.0 * lap), rel=0.01))


def test_a_mark_before_the_start_is_the_start():
    watch = LapWatch()
    follow(watch, np.full(50, 36e3))
    watch.mark(ago_s=100.0)
    assert watch.last_mark == (1, (0.0, 0.0))


def test_marks_go_before_the_period():
    watch = LapWatch()
    power = course(60, 8, seed=3)
    for k, watts in enumerate(power):
        if k % 600 == 0:
            watch.mark()
        watch.step(STEP_S, float(watts))
    watch.judge()
    assert watch.laps.source == "marks"
    assert watch.laps.confidence == 1.0


def test_marks_that_ended_long_ago_are_laps_no_more():
    watch = LapWatch()
    for _ in range(4):
        watch.mark()
        follow(watch, np.full(500, 36e3))
    assert watch.laps is not None
    rng = np.random.default_rng(5)
    follow(watch, 36e3 + 9e3 * rng.normal(size=1600))
    assert watch.laps is None
    assert watch.is_overdue


def test_the_share_of_a_lap_is_what_the_laps_before_used_up_to_there():
    """Laps of 60 s whose first 20 s take twice the power of the rest: half of the energy in a third of the time."""
    lap = np.repeat([60e3, 30e3], [200, 400])
    watch = LapWatch()
    assert watch.share_of_lap(0.0, 10.0) is None, "no lap is known"
    for _ in range(4):
        watch.mark()
        follow(watch, lap)
    watch.mark()
    watch.judge()
    line_s, _ = watch.now
    assert watch.share_of_lap(line_s, line_s) == pytest.approx(0.0, abs=0.01)
    assert watch.share_of_lap(line_s, line_s + 20.0) == pytest.approx(0.5, abs=0.02)
    assert watch.share_of_lap(line_s, line_s + 40.0) == pytest.approx(0.75, abs=0.02)
    assert watch.share_of_lap(line_s, line_s + 500.0) == pytest.approx(1.0, abs=0.01), "a slow lap has no more to come"


def test_a_line_with_no_lap_before_it_that_is_remembered_has_no_share():
    watch = LapWatch()
    for _ in range(3):
        watch.mark()
        follow(watch, np.full(600, 36e3))
    watch.judge()
    assert watch.share_of_lap(10.0, 20.0) is None


@pytest.mark.parametrize("scale", [0.1, 1.0, 3.0])
def test_the_period_does_not_depend_on_how_strong_the_car_is(scale):
    power = course(60, 8, seed=3)
    at = np.arange(power.size) * STEP_S
    assert lap_period_s(at, scale * power) == pytest.approx(lap_period_s(at, power), rel=1e-6)
    assert lap_period_s(at, power + 5e3) == pytest.approx(lap_period_s(at, power), rel=1e-3)


def test_the_period_does_not_depend_on_how_often_the_power_was_read():
    power = course(71, 8, seed=71)
    at = np.arange(power.size) * STEP_S
    assert lap_period_s(at[::5], power[::5]) == pytest.approx(lap_period_s(at, power), rel=0.01)
