"""Gaps of a measurement: the current to take for one, and how unsure its charge is.

In a gap of seconds the current is taken for the mean of its ends, in one of up to a minute more and more for that of
the minute around. It may have been any that this minute shows, and changes within some seconds; and from minute to
minute by as much as the drive does. A gap of more than a minute may hide a rest as well as a drive: the smaller current
of its ends, and as sigma what the usual current would have moved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from app.estimation.recording.cell_recording import GAP_STEPS

SHORT_GAP_S: Final = 60.0
ENDS_S: Final = 4.0  # the longest gap in which the ends alone count
CURRENT_LASTS_S: Final = 3.0  # correlation time of the current of a drive, apart from what changes over minutes
USUAL_S: Final = 1800.0  # memory of the usual current
STEPS_SEEN: Final = 20  # before a step is called unusual
SECONDS_PER_HOUR: Final = 3600.0


@dataclass(frozen=True)
class Gap:
    """Time in which nothing was measured: the current taken for it [A], and sigma of the charge that moved [Ah]."""

    current_a: float
    sigma_ah: float


@dataclass(frozen=True)
class Around:
    """The current around a gap [A].

    Attributes:
        mean_a: over the minute around.
        spread_a: standard deviation in that minute.
        slow_a: standard deviation of the means of minutes along the drive.
        usual_a: root mean square along the drive.
    """

    mean_a: float
    spread_a: float
    slow_a: float
    usual_a: float


def bridge_gap(gap_s: float, ends_a: tuple[float, float], around: Around, capacity_ah: float) -> Gap:
    """Return what is taken for a gap.

    Args:
        gap_s: its length [s].
        ends_a: current before and after it [A].
        around: the current in the minute around, and along the drive.
        capacity_ah: of the cell [Ah].
    """
    if gap_s > SHORT_GAP_S:
        return Gap(_smaller_a(ends_a, gap_s, capacity_ah), around.usual_a * gap_s / SECONDS_PER_HOUR)
    by_ends, share = min(1.0, ENDS_S / gap_s), min(1.0, 2.0 * CURRENT_LASTS_S / gap_s)
    current_a = by_ends * (ends_a[0] + ends_a[1]) / 2.0 + (1.0 - by_ends) * around.mean_a
    sigma_a = math.hypot(math.sqrt(share) * around.spread_a, (1.0 - by_ends) * around.slow_a)
    return Gap(current_a, sigma_a * gap_s / SECONDS_PER_HOUR)


def _smaller_a(ends_a: tuple[float, float], gap_s: float, capacity_ah: float) -> float:
    """Return the smaller current of the ends [A].

    None, where they differ in sign or would have moved half of the capacity: then nothing is known of it.
    """
    before_a, after_a = ends_a
    smaller_a = min(before_a, after_a, key=abs) if before_a * after_a > 0.0 else 0.0
    return smaller_a if abs(smaller_a) * gap_s < 0.5 * SECONDS_PER_HOUR * capacity_ah else 0.0


class GapWatch:
    """Finds the gaps of a stream of currents; call `step` with every measurement."""

    def __init__(self) -> None:
        self.usual_step_s = 0.0
        self._steps = 0
        self._current_a = 0.0
        self._minute = (0.0, 0.0)  # mean [A] and mean square [A^2] of the current over a minute
        self._usual = (0.0, 0.0, 0.0)  # over USUAL_S: mean [A], mean square, and mean square of the minute's mean [A^2]

    def is_gap(self, dt_s: float) -> bool:
        """Return whether a step of `dt_s` is much longer than those before it."""
        return self._steps >= STEPS_SEEN and dt_s > GAP_STEPS * self.usual_step_s

    def step(self, dt_s: float, current_a: float, capacity_ah: float) -> Gap | None:
        """Return the gap before a measurement, None where the step is a usual one.

        Args:
            dt_s: since the measurement before, >= 0 [s].
            current_a: measured now [A].
            capacity_ah: of the cell [Ah].
        """
        ends_a, self._current_a = (self._current_a, current_a), current_a
        gap = None
        if self.is_gap(dt_s):
            mean_a, mean_a2 = self._minute
            spread_a = math.sqrt(max(mean_a2 - mean_a**2, ((ends_a[1] - ends_a[0]) / 2.0) ** 2))
            usual_a, usual_a2, minutes_a2 = self._usual
            slow_a = math.sqrt(max(minutes_a2 - usual_a**2, 0.0))
            gap = bridge_gap(dt_s, ends_a, Around(mean_a, spread_a, slow_a, math.sqrt(usual_a2)), capacity_ah)
            dt_s = self.usual_step_s
        elif dt_s > 0.0:
            self._steps += 1
            self.usual_step_s += (dt_s - self.usual_step_s) / min(self._steps, 10 * STEPS_SEEN)
        short, long = 1.0 - math.exp(-dt_s / SHORT_GAP_S), 1.0 - math.exp(-dt_s / USUAL_S)
        mean_a, mean_a2 = self._minute
        self._minute = mean_a + short * (current_a - mean_a), mean_a2 + short * (current_a**2 - mean_a2)
        share, now = max(long, 1.0 / (self._steps + 1)), (current_a, current_a**2, self._minute[0] ** 2)
        usual_a, usual_a2, minutes_a2 = (old + share * (new - old) for old, new in zip(self._usual, now, strict=True))
        self._usual = usual_a, usual_a2, minutes_a2
        return gap
