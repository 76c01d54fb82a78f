"""Readers are listed while they read, the longest first."""

import asyncio
import platform
import subprocess
import sys
from contextlib import ExitStack

import pytest

from app.api.web.authentication import User
from app.api.web.readers import WAVE, Readers
from tests.fake_clock import FakeClock

ANNA = User("anna", "engineer")
HOLDS_FREE = """
from app.api.web.readers import give_memory_back

def mb():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

before = mb()
pieces = [bytearray(20_000) for _ in range(2000)]
on_top = bytearray(20_000)
del pieces
print(mb() - before)
give_memory_back()
print(mb() - before)
"""


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


def test_memory_is_given_back_once_after_many_have_left(monkeypatch):
    monkeypatch.setattr("app.api.web.readers.SETTLED_S", 0.0)
    waves = []
    readers = Readers(FakeClock(), lambda: waves.append(len(readers.everyone())))

    async def come_and_leave(n):
        with ExitStack() as stack:
            for _ in range(n):
                stack.enter_context(readers.joined(ANNA, "10.0.0.1"))
        for _ in range(3):
            await asyncio.sleep(0)

    asyncio.run(come_and_leave(WAVE - 1))
    assert waves == []
    asyncio.run(come_and_leave(3 * WAVE))
    assert waves == [0]
    asyncio.run(come_and_leave(WAVE))
    assert waves == [0, 0]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc can")
def test_what_is_held_free_goes_back_to_the_system():
    """Pieces too small to be mapped of their own, with one that stays on top."""
    said = subprocess.run([sys.executable, "-c", HOLDS_FREE], check=True, capture_output=True, text=True).stdout
    held, given_back = map(float, said.split())
    assert held > 30
    assert given_back < 5
