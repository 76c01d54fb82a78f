"""Who has the live stream open."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from app.api.web.authentication import User
from app.clock import Clock


class Reader(NamedTuple):
    """One open live stream."""

    user: User | None
    address: str
    since_s: float  # wall clock


class Readers:
    """Used on the event loop alone."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
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

    def everyone(self) -> list[Reader]:
        """Return the readers, longest first."""
        return list(self._open.values())
