"""Readers are listed while they read, the longest first."""

import pytest

from app.api.web.authentication import User
from app.api.web.readers import Readers
from tests.fake_clock import FakeClock

ANNA = User("anna", "engineer")


def test_readers_are_listed_with_since_when_and_leave_with_the_block():
    clock = FakeClock(wall_s=100.0)
    readers = Readers(clock)
    with readers.joined(ANNA, "10.0.0.1"):
        clock.advance(5)
        with readers.joined(None, "10.0.0.2"):
            assert readers.everyone() == [(ANNA, "10.0.0.1", 100.0), (None, "10.0.0.2", 105.0)]
        assert readers.everyone() == [(ANNA, "10.0.0.1", 100.0)]
    assert readers.everyone() == []


def test_one_that_ends_in_an_error_leaves_too():
    readers = Readers(FakeClock())
    with pytest.raises(ConnectionError), readers.joined(ANNA, "10.0.0.1"):
        raise ConnectionError
    assert readers.everyone() == []


def test_two_windows_of_one_person_are_two_readers():
    readers = Readers(FakeClock())
    with readers.joined(ANNA, "10.0.0.1"), readers.joined(ANNA, "10.0.0.1"):
        assert len(readers.everyone()) == 2
