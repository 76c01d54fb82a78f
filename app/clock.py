"""The computer's clocks as one object, handed in wherever time is read; tests hand in one that they turn."""

import time


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
