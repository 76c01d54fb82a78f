"""The SOC of before a restart or a silence, as far as it holds now: time away and the master's count weigh against it.

z, s are SOC and sigma of a cell, 0 before and 1 now; dq is the charge that the master has counted meanwhile, dm the
change of its SOC; t the time away. Where the master's clock shows that it ran on, its count is exact but for gain and
offset of its sensor:

    z1 = z0 - dq / C,   s1^2 = s0^2 + (g dq / C)^2 + (o t / C)^2

Otherwise the master may have begun a new count, and the accumulator may have been charged, driven or replaced. Two
hypotheses of what moved are updated by dm, which errs by v, and merged to their mean and variance: A, what the current
around shows, b with sigma w (at rest b = 0 and w is small), and B, which knows nothing beforehand:

    w^2 = gap^2 + r^2 + (d t)^2,   y = dm - b,   K = w^2 / (w^2 + v^2)
    A: b + K y, (1 - K) w^2        B: b + y, v^2
    p = P(A) N(y; 0, w^2 + v^2) / (P(A) N(y; 0, w^2 + v^2) + 1 - P(A))
    z1 = z0 + b + (1 - p (1 - K)) y
    s1^2 = s0^2 + p (1 - K) w^2 + (1 - p) v^2 + p (1 - p) ((1 - K) y)^2

Without a count A alone is left, and dm is none. Where no clock says how long it was, t is a month: the computer's ran
backwards, or the master's uptime is neither that of one that ran on nor of one that started meanwhile.

An estimator takes (z1, s1) for one hypothesis of its start among others: a cell that moved otherwise than the rest, or
a count that is wrong, is found by the voltage. The team's master, which counts in Ah, begins a new count with a
voltage, which the estimator reads itself: its dm is none, too.
"""

from dataclasses import dataclass, replace
from math import exp, pi, sqrt

import numpy as np

from app.estimation.filters.tuning import Tuning
from app.estimation.recording.gaps import SECONDS_PER_HOUR, Gap
from app.telemetry import FloatArray
from app.telemetry.measurement import Measurement

MASTER_SOC_SIGMA = 0.03  # v: of one number for all cells, counted on a chip
AS_KNOWN = 0.5  # P(A), before the master's count is looked at
REST_SIGMA = 0.01  # r: of what moves though nothing happens
SELF_DISCHARGE_SIGMA_PER_S = 0.001 / 86_400  # d
CLOCKS_APART_S, CLOCKS_DRIFT = 2.0, 2e-4  # by which the clocks of a master and of a computer differ
UNKNOWN_AWAY_S = 30 * 86_400.0  # taken for a time that no clock says


@dataclass(frozen=True)
class MasterCount:
    """The master's own count of the charge at one moment; None = it has none."""

    uptime_ms: int | None = None
    drawn_ah: float | None = None
    soc: float | None = None

    @classmethod
    def of(cls, measured: Measurement) -> "MasterCount":
        """Return that of a measurement."""
        return cls(measured.uptime_ms, measured.master.charge_drawn_ah, measured.master.soc)

    def drawn_since(self, before: "MasterCount", away_s: float) -> float | None:
        """Return the charge drawn since another count [Ah]; None where the master may have restarted in between."""
        if self.drawn_ah is None or before.drawn_ah is None or not self._ran_on(before, away_s):
            return None
        return self.drawn_ah - before.drawn_ah

    def contradicts(self, before: "MasterCount", away_s: float) -> bool:
        """Return whether the master can neither have run on for so long [s] nor have started within it."""
        if self.uptime_ms is None or before.uptime_ms is None or self._ran_on(before, away_s):
            return False
        return self.uptime_ms / 1000 > away_s + _clocks_differ_s(away_s)

    def _ran_on(self, before: "MasterCount", away_s: float) -> bool:
        if self.uptime_ms is None or before.uptime_ms is None:
            return False
        return abs((self.uptime_ms - before.uptime_ms) / 1000 - away_s) <= _clocks_differ_s(away_s)


def _clocks_differ_s(away_s: float) -> float:
    return CLOCKS_APART_S + CLOCKS_DRIFT * away_s


@dataclass(frozen=True)
class RememberedCharge:
    """The SOC of every cell at the last measurement."""

    t_wall_ns: int
    soc: FloatArray  # (n_cells,)
    soc_sigma: FloatArray
    count: MasterCount = MasterCount()
    moved: float = 0.0  # b, since then, as far as the current shows
    moved_sigma: float = 0.0  # gap

    def after(self, gap: Gap, gap_s: float, capacity_ah: float) -> "RememberedCharge":
        """Return the same with what a gap may have moved, where nothing but the current around it is known."""
        moved = -gap.current_a * gap_s / SECONDS_PER_HOUR / capacity_ah
        return replace(self, moved=moved, moved_sigma=gap.sigma_ah / capacity_ah)

    def drawn_ah(self, measured: Measurement, away_s: float) -> float | None:
        """Return what the master has counted since then [Ah]; None where it may have restarted."""
        return MasterCount.of(measured).drawn_since(self.count, away_s)

    def gap(self, measured: Measurement, away_s: float, capacity_ah: FloatArray, tuning: Tuning) -> Gap:
        """Return what moved since then as a gap of so long [s]; the rest as in `at`."""
        moved, variance = self._moved(MasterCount.of(measured), away_s, capacity_ah, tuning)
        mean_ah = float(capacity_ah.mean())
        return Gap(-float(np.mean(moved)) * mean_ah * SECONDS_PER_HOUR / away_s, sqrt(np.mean(variance)) * mean_ah)

    def at(self, measured: Measurement, capacity_ah: FloatArray, tuning: Tuning) -> tuple[FloatArray, FloatArray]:
        """Return (soc, sigma) now.

        Args:
            measured: now.
            capacity_ah: (n_cells,) [Ah].
            tuning: gain and offset of the current sensor.
        """
        count, clock_s = MasterCount.of(measured), (measured.t_wall_ns - self.t_wall_ns) / 1e9
        is_unknown = clock_s < -CLOCKS_APART_S or count.contradicts(self.count, max(clock_s, 0.0))
        away_s = UNKNOWN_AWAY_S if is_unknown else max(clock_s, 0.0)
        moved, variance = self._moved(count, away_s, capacity_ah, tuning)
        return self.soc + moved, np.sqrt(self.soc_sigma**2 + variance)

    def _moved(
        self, count: MasterCount, away_s: float, capacity_ah: FloatArray, tuning: Tuning
    ) -> tuple[FloatArray | float, FloatArray | float]:
        """Return z1 - z0 and s1^2 - s0^2."""
        drawn_ah = count.drawn_since(self.count, away_s)
        if drawn_ah is not None:
            offset = tuning.counter_offset_c * away_s / SECONDS_PER_HOUR
            return -drawn_ah / capacity_ah, (tuning.counter_gain * drawn_ah / capacity_ah) ** 2 + offset**2
        w2 = self.moved_sigma**2 + REST_SIGMA**2 + (SELF_DISCHARGE_SIGMA_PER_S * away_s) ** 2
        if count.drawn_ah is not None or count.soc is None or self.count.soc is None:
            return self.moved, w2
        y, v2 = count.soc - self.count.soc - self.moved, MASTER_SOC_SIGMA**2
        left = v2 / (w2 + v2)  # 1 - K
        likely = AS_KNOWN * exp(-(y**2) / (w2 + v2) / 2) / sqrt(2 * pi * (w2 + v2))
        p = likely / (likely + 1 - AS_KNOWN)
        variance = p * left * w2 + (1 - p) * v2 + p * (1 - p) * (left * y) ** 2
        return self.moved + (1 - p * left) * y, variance
