"""Laps driven, and the energy of each: by marks on the line, or by the period of the power.

The power of a lap repeats with the lap. A period counts where the power of the whole drive, smoothed, correlates with
itself one period earlier, over at least three laps, and stays found for half a lap: chance repetitions move on. Two
whole laps are needed of either kind. Time in which the car stands does not count as driving.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR

PERIOD_S: Final = (30.0, 200.0)  # what a lap of a Formula Student track can take
GRID_S: Final = 0.5
SMOOTH_S: Final = 3.0  # drivers do not pass a corner at the same instant of every lap
CORRELATION_MIN: Final = 0.5  # below, a period is rejected
CORRELATION_KEPT: Final = 0.35  # correlation of the last laps, once the period is known
FUNDAMENTAL_FRAC: Final = 0.8  # share of the highest peak: the first as high as this is one lap, later ones are more
SAME_PERIOD_FRAC: Final = 0.05
LAPS_MIN: Final = 3.0  # driven, before a period is looked at: two whole ones to compare with those before them
DRIVEN_MIN_S: Final = 150.0  # and this long: halves of a lap can look alike
STAYS_LAPS: Final = 0.5  # for which a period has to stay the same
OVERDUE_LAPS: Final = 3.0  # lap times without a lap: what was known of laps is of another drive
FORGOTTEN_LAPS: Final = 6.0  # lap times driven without one: look for a new period
TRACE_S: Final = 600.0  # driving that is kept
LAPS_KEPT: Final = 8
SHARE_LAPS: Final = 3  # before this one, that it is compared with
STANDING_W: Final = 1000.0  # less than this for STANDING_S is standing
STANDING_S: Final = 15.0
STOPPED_LAP_SHARE: Final = 0.25  # share of the median lap's energy: less is no lap
UNKNOWN_S: Final = 10.0  # what flowed in a longer gap is not known

LapSource = Literal["marks", "period"]


@dataclass(frozen=True)
class Laps:
    """Laps driven: (n_laps,) energies [Wh], the newest last; the usual time of a lap [s]; how they are known.

    `confidence` is the correlation of the power with that of a lap before, 1 where the line was marked.
    """

    energies_wh: FloatArray
    period_s: float
    source: LapSource
    confidence: float


@dataclass(frozen=True)
class _Mark:
    time_s: float
    driving_s: float
    energy_wh: float


class LapWatch:
    """Follows the power; `step` with every sample, `judge` every few seconds."""

    def __init__(self) -> None:
        self.laps: Laps | None = None
        self.is_overdue = False  # laps were known, and none came for `OVERDUE_LAPS`
        self._time_s = self._driving_s = self._energy_wh = self._standing_s = 0.0
        self._trace: deque[tuple[float, float]] = deque([(0.0, 0.0)])  # driving time and energy
        self._marks: deque[_Mark] = deque(maxlen=LAPS_KEPT + 1)
        self._n_marks = 0
        self._candidate: tuple[float, float] | None = None  # period, and since when by the driving time
        self._period_s: float | None = None
        self._seen_s = self._seen_driving_s = 0.0  # when the period was last confirmed
        self._judged_driving_s = 0.0

    def step(self, dt_s: float, power_w: float) -> None:
        """Take one sample: `dt_s` since the one before [s], power of the accumulator, positive on discharge [W]."""
        self._time_s += dt_s
        if dt_s > UNKNOWN_S:
            return
        self._standing_s = self._standing_s + dt_s if abs(power_w) < STANDING_W else 0.0
        if self._standing_s > STANDING_S:
            return
        self._driving_s += dt_s
        self._energy_wh += power_w * dt_s / SECONDS_PER_HOUR
        if self._driving_s - self._trace[-1][0] >= GRID_S:
            self._trace.append((self._driving_s, self._energy_wh))
            while self._driving_s - self._trace[0][0] > TRACE_S:
                self._trace.popleft()

    def mark(self, ago_s: float = 0.0) -> None:
        """The line is crossed now, or was so long ago [s]."""
        driving_s = max(self._driving_s - ago_s, 0.0)
        self._marks.append(_Mark(self._time_s - ago_s, driving_s, self.energy_at(driving_s)))
        self._n_marks += 1

    @property
    def now(self) -> tuple[float, float]:
        """Time driven [s] and energy taken out [Wh] since the start."""
        return self._driving_s, self._energy_wh

    @property
    def last_mark(self) -> tuple[int, tuple[float, float] | None]:
        """Return the number of marks on the line, and the time of the last, as `now`."""
        return self._n_marks, (self._marks[-1].driving_s, self._marks[-1].energy_wh) if self._marks else None

    def energy_at(self, driving_s: float) -> float:
        """Return the energy that was taken out at a time driven [Wh]; older than `TRACE_S` is the oldest known."""
        time_s, energy_wh = np.array((*self._trace, self.now)).T
        return float(np.interp(driving_s, time_s, energy_wh))

    def share_of_lap(self, line_s: float, now_s: float) -> float | None:
        """Return what part of a lap's energy was usual at this point of the lap, by those before; None unknown.

        Args:
            line_s: when this lap began, by the time driven [s].
            now_s: the time driven now [s].
        """
        if self.laps is None:
            return None
        period_s = self.laps.period_s
        elapsed_s = min(now_s - line_s, period_s)
        shares = []
        for start_s in line_s - period_s * np.arange(1, SHARE_LAPS + 1):
            if start_s >= self._trace[0][0]:
                at_wh = [self.energy_at(start_s + s) for s in (0.0, elapsed_s, period_s)]
                if at_wh[2] > at_wh[0]:
                    shares.append((at_wh[1] - at_wh[0]) / (at_wh[2] - at_wh[0]))
        return float(np.mean(shares)) if shares else None

    def judge(self) -> None:
        """Find the laps anew: `laps`, None where they are not known."""
        self.laps = self._by_marks() or self._by_period()
        self.is_overdue = self.laps is None and (self._period_s is not None or len(self._marks) > 2)

    def _by_marks(self) -> Laps | None:
        if len(self._marks) < 3:
            return None
        at = np.array([(mark.time_s, mark.driving_s, mark.energy_wh) for mark in self._marks])
        took_s, drove_s, energy_wh = np.diff(at, axis=0).T
        whole = took_s - drove_s < STANDING_S  # a lap with a stop is none
        if whole.sum() < 2:
            return None
        period_s = float(np.median(took_s[whole]))
        if self._time_s - at[-1, 0] > OVERDUE_LAPS * period_s:
            return None
        return Laps(energy_wh[whole], period_s, "marks", 1.0)

    def _by_period(self) -> Laps | None:
        drove = self._driving_s > self._judged_driving_s
        self._judged_driving_s = self._driving_s
        power_w = self._power_w()
        if self._period_s is None:
            self._period_s = self._new_period(power_w)
            if self._period_s is None:
                return None
            self._seen_s, self._seen_driving_s = self._time_s, self._driving_s
        period_s = self._period_s
        last = power_w[-round(LAPS_MIN * period_s / GRID_S) :]
        lags, correlation = _correlation(last, (1.0 - SAME_PERIOD_FRAC) * period_s, (1.0 + SAME_PERIOD_FRAC) * period_s)
        best = int(correlation.argmax()) if correlation.size else 0
        confidence = float(correlation[best]) if correlation.size else 0.0
        is_overdue = self._time_s - self._seen_s > OVERDUE_LAPS * period_s
        driven_s = self._driving_s - self._seen_driving_s
        enough, least_s = (CORRELATION_MIN, period_s) if is_overdue else (CORRELATION_KEPT, 0.0)
        if drove and confidence >= enough and driven_s >= least_s:
            self._seen_s, self._seen_driving_s = self._time_s, self._driving_s
            self._period_s = period_s = float(0.8 * period_s + 0.2 * lags[best])
        elif driven_s > FORGOTTEN_LAPS * period_s:
            self._forget()
            return None
        elif is_overdue:
            return None
        energies_wh = self._energies_wh(period_s)
        return Laps(energies_wh, period_s, "period", confidence) if energies_wh.size >= 2 else None

    def _new_period(self, power_w: FloatArray) -> float | None:
        """Return the period once it has stayed the same for long enough."""
        found_s = period_of(power_w)
        if found_s is None or max(found_s * LAPS_MIN, DRIVEN_MIN_S) > self._driving_s - self._trace[0][0]:
            self._candidate = None
            return None
        if self._candidate is None or abs(found_s / self._candidate[0] - 1.0) > SAME_PERIOD_FRAC:
            self._candidate = found_s, self._driving_s
        return found_s if self._driving_s - self._candidate[1] >= STAYS_LAPS * found_s else None

    def _power_w(self) -> FloatArray:
        """Return the mean power in each `GRID_S` of driving [W]."""
        time_s, energy_wh = np.array(self._trace).T
        grid = np.arange(time_s[0], time_s[-1], GRID_S)
        return np.asarray(np.diff(np.interp(grid, time_s, energy_wh)) * SECONDS_PER_HOUR / GRID_S)

    def _energies_wh(self, period_s: float) -> FloatArray:
        time_s, energy_wh = np.array(self._trace).T
        n_laps = min(LAPS_KEPT, int((time_s[-1] - time_s[0]) / period_s))
        marks = time_s[-1] - period_s * np.arange(n_laps, -1, -1)
        laps = np.diff(np.interp(marks, time_s, energy_wh))
        return np.asarray(laps[laps > STOPPED_LAP_SHARE * np.median(laps)]) if laps.size else laps

    def _forget(self) -> None:
        self._period_s = self._candidate = None
        while self._trace[0][0] < self._seen_driving_s:
            self._trace.popleft()


def period_of(power_w: FloatArray, correlation_min: float = CORRELATION_MIN) -> float | None:
    """Return the period of a lap [s], None where the power does not repeat.

    Args:
        power_w: (n,) mean power in each `GRID_S` of driving [W].
        correlation_min: of the power with that of a lap before, below which a period is rejected.
    """
    n_smooth = round(SMOOTH_S / GRID_S)
    if power_w.size < 2 * PERIOD_S[0] / GRID_S:
        return None
    smooth = np.convolve(power_w, np.full(n_smooth, 1.0 / n_smooth), "valid")
    lags, correlation = _correlation(smooth, PERIOD_S[0], min(PERIOD_S[1], 0.5 * GRID_S * smooth.size))
    if correlation.size < 3:
        return None
    inner = correlation[1:-1]
    peaks = np.flatnonzero((inner >= correlation[:-2]) & (inner > correlation[2:])) + 1
    peaks = peaks[correlation[peaks] >= correlation_min]
    if peaks.size == 0:
        return None
    best = int(peaks[correlation[peaks] >= FUNDAMENTAL_FRAC * correlation[peaks].max()][0])
    left, middle, right = correlation[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(lags[best] + offset * GRID_S)


def lap_period_s(time_s: FloatArray, power_w: FloatArray, correlation_min: float = CORRELATION_MIN) -> float | None:
    """Return the period of a lap [s] in samples of the power, None where it does not repeat.

    Args:
        time_s: (n,) rising [s].
        power_w: (n,) power of the accumulator [W].
        correlation_min: as for `period_of`.
    """
    if time_s.size < 2:
        return None
    energy_j = np.concatenate(([0.0], np.cumsum(0.5 * (power_w[1:] + power_w[:-1]) * np.diff(time_s))))
    grid = np.arange(time_s[0], time_s[-1], GRID_S)
    return period_of(np.diff(np.interp(grid, time_s, energy_j)) / GRID_S, correlation_min)


def _correlation(power_w: FloatArray, from_s: float, to_s: float) -> tuple[FloatArray, FloatArray]:
    """Return lags [s] and the correlation of the power with itself so much earlier, over what overlaps."""
    first, last = max(int(from_s / GRID_S), 1), min(int(np.ceil(to_s / GRID_S)), power_w.size // 2)
    lags = np.arange(first, last + 1)
    if lags.size == 0:
        return np.empty(0), np.empty(0)
    x = power_w - power_w.mean()
    n = x.size
    spectrum = np.fft.rfft(x, 2 * n)
    product = np.fft.irfft(np.abs(spectrum) ** 2)[lags]
    sums = np.concatenate(([0.0], np.cumsum(x)))
    squares = np.concatenate(([0.0], np.cumsum(x * x)))
    m = n - lags
    early, late = sums[m], sums[n] - sums[lags]
    early_var = squares[m] - early**2 / m
    late_var = squares[n] - squares[lags] - late**2 / m
    scale = np.sqrt(np.maximum(early_var, 0.0) * np.maximum(late_var, 0.0))
    covariance = product - early * late / m
    correlation = np.zeros(lags.size)
    np.divide(covariance, scale, out=correlation, where=scale > 0.0)
    return np.asarray(lags * GRID_S, dtype=np.float64), correlation
