"""The computer's clocks as one object, handed in wherever time is read; tests hand in one that they turn."""

import secrets
import time

_AWAKE = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC", None))  # goes on while the computer sleeps
_SLEPT_S = 0.5  # no pause between two readings, but sleep


class Clock:
    """Two readings: intervals come from the monotonic clock, times of day from the wall clock."""

    def monotonic_ns(self) -> int:
        """Return nanoseconds that only grow, from an unknown start."""
        return time.monotonic_ns()

    def wall_ns(self) -> int:
        """Return nanoseconds since 1970 UTC; somebody may set this clock."""
        return time.time_ns()

    def monotonic_s(self) -> float:
        """Return the monotonic clock in seconds."""
        return self.monotonic_ns() / 1e9

    def wall_s(self) -> float:
        """Return the wall clock in seconds."""
        return self.wall_ns() / 1e9

    def slept_s(self) -> float:
        """Return for how long the computer slept since it started, where the monotonic clock stands; else 0."""
        return 0.0 if _AWAKE is None else time.clock_gettime(_AWAKE) - time.monotonic()


class ClockRun:
    """Names a run of the monotonic clock: another start, and what comes after a sleep, counts from elsewhere.

    Who receives of times of this clock may take two of one run for times of one clock, and of no other.
    """

    def __init__(self, clock: Clock) -> None:
        """Begin a run."""
        self._clock = clock
        self._slept_s = clock.slept_s()
        self._id = secrets.token_hex(4)

    @property
    def id(self) -> str:
        """The run's name, by chance; a new one after a sleep."""
        slept_s = self._clock.slept_s()
        if abs(slept_s - self._slept_s) > _SLEPT_S:
            self._slept_s, self._id = slept_s, secrets.token_hex(4)
        return self._id
