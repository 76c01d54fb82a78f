"""The clock reads the computer's own, in nanoseconds and in seconds."""

import time

from app.clock import Clock, ClockRun
from tests.fake_clock import FakeClock


def test_the_wall_clock_is_the_computers():
    before_ns = time.time_ns()
    assert before_ns <= Clock().wall_ns() <= time.time_ns()


def test_the_monotonic_clock_is_the_computers():
    before_ns = time.monotonic_ns()
    assert before_ns <= Clock().monotonic_ns() <= time.monotonic_ns()


def test_seconds_follow_from_nanoseconds():
    clock = FakeClock(monotonic_s=12.5, wall_s=99.25)
    assert (clock.monotonic_s(), clock.wall_s()) == (12.5, 99.25)


def test_setting_the_wall_clock_leaves_intervals_alone():
    clock = FakeClock(monotonic_s=10)
    clock.set_wall(5)
    clock.advance(1)
    assert (clock.monotonic_s(), clock.wall_s()) == (11.0, 6.0)


class SleepyClock(FakeClock):
    """A computer that sleeps: its monotonic clock stands meanwhile."""

    slept = 0.0

    def slept_s(self):
        return self.slept


def test_a_run_of_the_clock_has_one_name_until_the_computer_sleeps():
    clock = SleepyClock()
    run = ClockRun(clock)
    first = run.id
    clock.advance(3600.0)
    clock.slept = 1e-5  # two clocks are never read at once
    assert run.id == first
    clock.slept = 600.0
    second = run.id
    assert second != first
    clock.slept = 600.4
    assert run.id == second
    assert ClockRun(clock).id != second  # another start


def test_this_computer_did_not_sleep_between_two_readings():
    assert abs(Clock().slept_s() - Clock().slept_s()) < 0.4
