"""The waits of a link that is lost: longer each time, never all at once, never longer than the cap."""

import random

import pytest

from app.sources.links.serial import Backoff


class Extreme(random.Random):
    """A generator that always gives the same end of its range."""

    def __init__(self, value):
        super().__init__()
        self._value = value

    def random(self):
        return self._value


def waits(backoff, n):
    return [backoff.next_s() for _ in range(n)]


def test_each_failure_doubles_the_wait_up_to_the_cap():
    assert waits(Backoff(0.2, 2.0, Extreme(1.0)), 6) == pytest.approx([0.2, 0.4, 0.8, 1.6, 2.0, 2.0])
    assert waits(Backoff(0.2, 2.0, Extreme(0.0)), 6) == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.0, 1.0])


def test_a_success_starts_anew():
    backoff = Backoff(0.2, 2.0, Extreme(1.0))
    waits(backoff, 4)
    backoff.reset()
    assert backoff.next_s() == pytest.approx(0.2)


def test_two_links_that_were_lost_together_do_not_come_back_together():
    first, second = (waits(Backoff(rng=random.Random(seed)), 5) for seed in (1, 2))
    assert all(a != b for a, b in zip(first, second, strict=True))


def test_the_first_wait_is_short_and_the_longest_two_seconds():
    backoff = Backoff(rng=random.Random(3))
    found = waits(backoff, 50)
    assert 0.1 <= found[0] <= 0.2
    assert all(1.0 <= wait <= 2.0 for wait in found[5:])
