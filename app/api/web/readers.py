"""Who has the live stream open; when many have left, their memory is given back to the system.

What a connection takes lies among what stays, so the C library keeps it for the next ones: 2 MB of a thousand readers,
and more with each thousand.
"""

import asyncio
import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from app.api.web.authentication import User
from app.clock import Clock

WAVE = 50  # readers that left
SETTLED_S = 2.0  # by then their connections are gone, too


def give_memory_back() -> None:
    """Ask the C library to return what it holds free; only glibc can."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if os.name == "posix" else None
    if trim is not None:
        trim(0)


class Reader(NamedTuple):
    """One open live stream."""

    user: User | None
    address: str
    since_s: float  # wall clock


class Readers:
    """Used on the event loop alone."""

    def __init__(self, clock: Clock, on_wave: Callable[[], object] = give_memory_back) -> None:
        """`on_wave` is called a while after many have left."""
        self._clock = clock
        self._on_wave = on_wave
        self._n_left = 0
        self._open: dict[object, Reader] = {}

    @contextmanager
    def joined(self, user: User | None, address: str) -> Iterator[None]:
        """Count a reader for the length of a with-block."""
        key = object()
        self._open[key] = Reader(user, address, self._clock.wall_s())
        try:
            yield
        finally:
            del self._open[key]
            self._n_left += 1
            if self._n_left == WAVE:
                asyncio.get_running_loop().call_later(SETTLED_S, self._wave_is_over)

    def everyone(self) -> list[Reader]:
        """Return the readers, longest first."""
        return list(self._open.values())

    def _wave_is_over(self) -> None:
        self._n_left = 0
        self._on_wave()
