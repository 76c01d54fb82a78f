"""What may have flowed while nothing was measured: the current to take for a gap, and how unsure the charge is.

In a short gap the current is taken for the mean of its ends; it may have been any that the minute around shows, and
changes within some seconds. A gap of more than a minute may hide a rest as well as a drive: the smaller current of its
ends, and as sigma what the usual current would have moved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from app.estimation.recording.cell_recording import GAP_STEPS

SHORT_GAP_S: Final = 60.0
CURRENT_LASTS_S: Final = 2.0  # correlation time of the current of a drive
USUAL_S: Final = 1800.0  # memory of the usual current
STEPS_SEEN: Final = 20  # before a step is called unusual
SECONDS_PER_HOUR: Final = 3600.0


@dataclass(frozen=True)
class Gap:
    """Time in which nothing was measured: the current taken for it [A], and sigma of the charge that moved [Ah]."""

    current_a: float
    sigma_ah: float


def bridge_gap(gap_s: float, ends_a: tuple[float, float], spread_a: float, usual_a: float, capacity_ah: float) -> Gap:
    """Return what is taken for a gap.

    Args:
        gap_s: its length [s].
        ends_a: current before and after it [A].
        spread_a: standard deviation of the current in the minute around [A].
        usual_a: root mean square of the current of the recording [A].
        capacity_ah: of the cell [Ah].
    """
    if gap_s > SHORT_GAP_S:
        return Gap(_smaller_a(ends_a, gap_s, capacity_ah), usual_a * gap_s / SECONDS_PER_HOUR)
    share = min(1.0, 2.0 * CURRENT_LASTS_S / gap_s)
    return Gap((ends_a[0] + ends_a[1]) / 2.0, math.sqrt(share) * spread_a * gap_s / SECONDS_PER_HOUR)


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
        self._usual_a2 = 0.0  # mean square of it over USUAL_S

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
            gap = bridge_gap(dt_s, ends_a, spread_a, math.sqrt(self._usual_a2), capacity_ah)
            dt_s = self.usual_step_s
        elif dt_s > 0.0:
            self._steps += 1
            self.usual_step_s += (dt_s - self.usual_step_s) / min(self._steps, 10 * STEPS_SEEN)
        short, long = 1.0 - math.exp(-dt_s / SHORT_GAP_S), 1.0 - math.exp(-dt_s / USUAL_S)
        mean_a, mean_a2 = self._minute
        self._minute = mean_a + short * (current_a - mean_a), mean_a2 + short * (current_a**2 - mean_a2)
        self._usual_a2 += max(long, 1.0 / (self._steps + 1)) * (current_a**2 - self._usual_a2)
        return gap
