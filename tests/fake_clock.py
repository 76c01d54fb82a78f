"""A clock that stands still until a test turns it."""

import time
from collections.abc import Callable

from app.clock import Clock

NS_PER_S = 1_000_000_000


class FakeClock(Clock):
    """Starts at a monotonic time of 1000 s, on 14 November 2023."""

    def __init__(self, monotonic_s: float = 1_000.0, wall_s: float = 1_700_000_000.0) -> None:
        self._monotonic_ns = round(monotonic_s * NS_PER_S)
        self._wall_ns = round(wall_s * NS_PER_S)

    def monotonic_ns(self) -> int:
        return self._monotonic_ns

    def wall_ns(self) -> int:
        return self._wall_ns

    def advance(self, seconds: float) -> None:
        """Let time pass on both clocks."""
        self._monotonic_ns += round(seconds * NS_PER_S)
        self._wall_ns += round(seconds * NS_PER_S)

    def set_wall(self, seconds: float) -> None:
        """Set the wall clock, as a person or a time server does; the monotonic clock does not notice."""
        self._wall_ns = round(seconds * NS_PER_S)


class FunctionClock(Clock):
    """A clock whose readings are functions of the test; without `wall_ns` the computer's wall clock."""

    def __init__(self, monotonic_ns: Callable[[], int], wall_ns: Callable[[], int] = time.time_ns) -> None:
        self._monotonic_ns = monotonic_ns
        self._wall_ns = wall_ns

    def monotonic_ns(self) -> int:
        return self._monotonic_ns()

    def wall_ns(self) -> int:
        return self._wall_ns()
