"""A guesser is slowed; the right person comes in from elsewhere."""

import pytest

from app.api.access.login_attempts import ATTACKED_AFTER, FEW, PER_MINUTE, LoginAttempts
from tests.fake_clock import FakeClock


@pytest.fixture
def clock():
    return FakeClock()


@pytest.fixture
def guesses(clock):
    return LoginAttempts(clock)


def tries(guesses, clock, address, account="ada", seconds=3600):
    """How many tries, one a second, are checked."""
    checked = 0
    for _ in range(seconds):
        if guesses.begin(account, address) == 0:
            guesses.failed(account)
            checked += 1
        clock.advance(1)
    return checked


def test_an_address_has_less_than_a_hundred_guesses_an_hour_at_a_person(guesses, clock):
    assert PER_MINUTE < tries(guesses, clock, "10.0.0.1") < 100


def test_meanwhile_that_person_comes_in_from_another_address(guesses, clock):
    tries(guesses, clock, "10.0.0.1")
    assert guesses.begin("ada", "10.0.0.2") == 0


def test_who_guesses_at_many_people_is_slowed_by_the_minute(guesses):
    assert [guesses.begin(f"person {i}", "10.0.0.1") == 0 for i in range(PER_MINUTE + 1)][-1] is False


def test_guessed_at_from_everywhere_each_address_has_few(guesses):
    for i in range(ATTACKED_AFTER):
        assert guesses.begin("ada", f"10.0.1.{i}") == 0
        guesses.failed("ada")
    assert [guesses.begin("ada", "10.0.0.1") == 0 for _ in range(FEW + 1)] == [True] * FEW + [False]


def test_who_was_right_begins_anew(guesses):
    for _ in range(PER_MINUTE):
        assert guesses.begin("ada", "10.0.0.1") == 0
        guesses.right("ada", "10.0.0.1", forgets=True)
    assert guesses.begin("ada", "10.0.0.1") == 0
