"""The clock reads the computer's own, in nanoseconds and in seconds."""

import time

from app.clock import Clock
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
