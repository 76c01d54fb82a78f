"""Lap detection: from the power's own pattern, from marks that somebody set, or from a counter on CAN."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.prediction.laps import lap_period_s

GRID_S: Final = 0.2
DRIVING_SHARE: Final = 0.1  # share of the highest usual power; less is standing
DRIVING_MIN_W: Final = 1000.0
STOP_S: Final = 15.0  # without power for longer: the car stood, and what follows is another stint
STINT_MIN_S: Final = 30.0
PERIOD_FROM_S: Final = 900.0  # length of a stint that shows its period
CORRELATION_MIN: Final = 0.3  # correlation of a whole stint; the pattern is followed from lap to lap afterwards
SEARCH: Final = (0.8, 1.25)  # bounds of the next lap's length, in periods
LEARN: Final = 0.3  # weight of the newest lap in what a lap looks like
UNUSUAL: Final = 4.0  # taken off the correlation, times the square of how far a lap is off the usual time
MATCH_MIN: Final = 0.2  # correlation below which the pattern is lost and the period alone counts
LAST_LAP: Final = (0.85, 1.2)  # in periods: a stint that ends within them ended on the line, or a little before it
LINE: Final = 0.02  # in periods: the pattern places the line this precisely
GAP_S: Final = 5.0  # without a sample after the last power: whether the car stopped is not known


@dataclass(frozen=True)
class Stint:
    """A stretch of driving without a long stop [s]."""

    start_s: float
    end_s: float


class PatternLap(NamedTuple):
    """A lap by the pattern of the power [s]; a partial one was cut off before the car came round."""

    start_s: float
    end_s: float
    is_partial: bool


def stints(time_s: FloatArray, power_w: FloatArray) -> list[Stint]:
    """Return the stretches of driving.

    Args:
        time_s: (n,) rising [s].
        power_w: (n,) power [W], NaN where not measured.
    """
    is_finite = np.isfinite(power_w)
    if not is_finite.any():
        return []
    magnitude = np.abs(power_w[is_finite])
    threshold_w = max(DRIVING_MIN_W, DRIVING_SHARE * float(np.percentile(magnitude, 95)))
    at_s = time_s[is_finite][magnitude > threshold_w]
    if not at_s.size:
        return []
    breaks = np.flatnonzero(np.diff(at_s) > STOP_S)
    starts, ends = np.concatenate(([0], breaks + 1)), np.concatenate((breaks, [at_s.size - 1]))
    runs = [Stint(float(at_s[i]), float(at_s[j])) for i, j in zip(starts, ends, strict=True)]
    return [stint for stint in runs if stint.end_s - stint.start_s >= STINT_MIN_S]


def laps_by_pattern(time_s: FloatArray, power_w: FloatArray) -> list[PatternLap]:
    """Return every lap by the repetition of the power.

    The first lap of a stint begins where the driving does, every other one where the pattern of the laps before comes
    again, so all laps of a stint begin at one place of the track, which need not be the line. The last one is partial
    where the recording ends while the car drives, or the car stops before that place.

    Args:
        time_s: (n,) rising [s].
        power_w: (n,) power [W], NaN where not measured.
    """
    driven = stints(time_s, power_w)
    periods = [_period_s(time_s, power_w, stint) for stint in driven]
    measured = [period for period in periods if period is not None]
    if not measured:
        return []
    usual_s = float(np.median(measured))
    laps: list[PatternLap] = []
    for stint, period_s in zip(driven, periods, strict=True):
        marks, is_cut_off = _marks_of_stint(time_s, power_w, stint, period_s or usual_s)
        laps += [PatternLap(*span, is_partial=is_cut_off and span[1] == marks[-1]) for span in pairwise(marks)]
    return laps


def laps_by_marks(marks_s: list[float], driving: list[Stint]) -> list[tuple[float, float]]:
    """Return the laps between marks [s]; none across a stop between two stints.

    Args:
        marks_s: when the line was crossed.
        driving: as `stints` returns it; empty where nothing is known of the power, then every two marks make a lap.
    """
    laps = list(pairwise(sorted(set(marks_s))))
    stops = list(pairwise(driving))
    return [
        (start, end)
        for start, end in laps
        if not any(start < before.end_s and end > after.start_s for before, after in stops)
    ]


def rises_s(time_s: FloatArray, values: FloatArray) -> list[float]:
    """Return when a number went up: a lap counter, or the bit of a beacon [s]; one that wraps round counts too.

    Args:
        time_s: (n,) rising [s].
        values: (n,) of the counter or the bit.
    """
    if values.size < 2:
        return []
    step = np.diff(values)
    top, low = values.max(), values.min()
    is_counter = len(np.unique(values)) > 2  # a bit that falls does not wrap round
    wraps = is_counter & (step < 0) & (values[:-1] == top) & (values[1:] == low)
    return [float(t) for t in time_s[1:][(step > 0) | wraps]]


def _period_s(time_s: FloatArray, power_w: FloatArray, stint: Stint) -> float | None:
    """The usual time of a lap."""
    chosen = (time_s >= stint.start_s) & (time_s <= min(stint.end_s, stint.start_s + PERIOD_FROM_S))
    chosen &= np.isfinite(power_w)
    if chosen.sum() <= 2:
        return None
    return lap_period_s(time_s[chosen], power_w[chosen], CORRELATION_MIN)


def _energy_j(time_s: FloatArray, power_w: FloatArray) -> FloatArray:
    return np.concatenate(([0.0], np.cumsum(0.5 * (power_w[1:] + power_w[:-1]) * np.diff(time_s))))


def _stops(time_s: FloatArray, stint: Stint) -> bool:
    """Whether the car is seen to stand after a stint; else the recording, or what it receives, ends while it drives."""
    after = time_s[(time_s > stint.end_s) & (time_s < stint.end_s + STOP_S)]
    return float(np.diff(after, prepend=stint.end_s, append=stint.end_s + STOP_S).max()) < GAP_S


def _marks_of_stint(time_s: FloatArray, power_w: FloatArray, stint: Stint, period_s: float) -> tuple[list[float], bool]:
    """Follow the pattern from lap to lap: what surrounded the marks before is looked for about a period later.

    Returns the marks, and whether the stint was cut off at the last one.
    """
    is_finite = np.isfinite(power_w)
    stops = _stops(time_s[is_finite], stint)
    grid = np.arange(stint.start_s, stint.end_s + GRID_S, GRID_S)
    power = np.diff(np.interp(grid, time_s[is_finite], _energy_j(time_s[is_finite], power_w[is_finite]))) / GRID_S
    half = round(0.5 * period_s / GRID_S)
    pattern = _stretch_around(power, 0, half)
    marks = [0.0]
    is_cut_off = False
    while True:
        usual = float(np.median(np.diff(marks))) if len(marks) > 1 else period_s / GRID_S
        left = len(power) - marks[-1]
        mark, score = _next_mark(power, pattern, marks[-1], usual)
        before_end = len(power) - mark  # negative: the line would have come later
        if LAST_LAP[0] * usual <= left <= LAST_LAP[1] * usual:
            is_found = score >= MATCH_MIN
            crossed = is_found and not stops and before_end > LINE * usual
            falls_short = before_end < -LINE * usual if is_found else left < usual
            is_cut_off = not crossed and (not stops or falls_short)
            marks.append(mark if crossed else float(len(power)))
        elif left > usual:
            marks.append(mark if score >= MATCH_MIN and before_end >= 0.0 else marks[-1] + usual)
            pattern = _learnt(pattern, _stretch_around(power, round(marks[-1]), half))
            continue
        return [stint.start_s + mark * GRID_S for mark in marks], is_cut_off


def _next_mark(power: FloatArray, pattern: FloatArray, mark: float, usual: float) -> tuple[float, float]:
    """Return where the pattern comes again, near the usual length of a lap rather than far off it, and how well."""
    low, high = (round(mark + share * usual) for share in SEARCH)
    places = np.arange(low, high + 1)  # beyond the end: where the line would have come
    matches = np.array([_match(pattern, _stretch_around(power, int(at), len(pattern) // 2)) for at in places])
    scores = matches - UNUSUAL * ((places - mark) / usual - 1.0) ** 2
    best = int(scores.argmax())
    return float(places[best]) + _peak_offset(scores, best), float(matches[best])


def _stretch_around(power: FloatArray, at: int, half: int) -> FloatArray:
    """Return (2 half,) power around a place, NaN beyond the stint."""
    stretch = np.full(2 * half, np.nan)
    first, last = max(at - half, 0), min(at + half, len(power))
    if first < last:
        stretch[first - at + half : last - at + half] = power[first:last]
    return stretch


def _match(pattern: FloatArray, candidate: FloatArray) -> float:
    both = np.isfinite(pattern) & np.isfinite(candidate)
    if both.sum() < len(pattern) // 5:
        return -1.0
    a, b = pattern[both] - pattern[both].mean(), candidate[both] - candidate[both].mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0.0 else -1.0


def _learnt(pattern: FloatArray, newest: FloatArray) -> FloatArray:
    mixed = (1.0 - LEARN) * pattern + LEARN * newest
    return np.where(np.isnan(mixed), np.where(np.isnan(pattern), newest, pattern), mixed)


def _peak_offset(scores: FloatArray, best: int) -> float:
    if not 0 < best < len(scores) - 1:
        return 0.0
    left, middle, right = scores[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    return float(0.5 * (left - right) / bend) if bend < 0.0 else 0.0
