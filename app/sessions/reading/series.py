"""Samples to a chart's points: smallest and largest per bucket, gaps kept. Pure numpy."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.sessions.reading.blocks import BlockColumn
from app.sessions.storage.chunks import Track
from app.sessions.storage.streams import CountArray

_SHORTEST_GAP_S = 0.5
_STEPS_LOOKED_AT = 4096  # to know what is usual
_GAP_PERIODS = 3.5  # samples missing in a row that make a gap


@dataclass(frozen=True, slots=True)
class SessionSeries:
    """One signal over time: (n,) times [s since 1970 UTC], smallest and largest value in the unit.

    NaN in both is a gap, or not measured.
    """

    name: str
    unit: str
    time_s: FloatArray
    minimum: FloatArray
    maximum: FloatArray
    gaps: tuple[tuple[float, float], ...]


def find_gaps(times_s: FloatArray) -> NDArray[np.intp]:
    """Indices after which the next of the (n,) ascending times is missing for longer than usual."""
    steps = np.diff(times_s)
    if not len(steps):
        return np.empty(0, np.intp)
    usual_s = float(np.median(steps[:: len(steps) // _STEPS_LOOKED_AT + 1]))
    return np.flatnonzero(steps > max(_SHORTEST_GAP_S, _GAP_PERIODS * usual_s))


def reduce_samples(name: str, unit: str, times_s: FloatArray, values: FloatArray, points: int) -> SessionSeries:
    """Return at most `points` buckets of equal duration, plus one NaN in every gap.

    Args:
        name: passed on.
        unit: passed on.
        times_s: (n,) ascending [s].
        values: (n,) in the unit, NaN where not measured.
        points: at least 1. With no more samples than this, each one is kept as it is.
    """
    after = find_gaps(times_s)
    gaps = tuple((float(times_s[i]), float(times_s[i + 1])) for i in after)
    if len(times_s) <= points:
        time_s, low, high = times_s, values, values
        last_before = after
    else:
        width = (times_s[-1] - times_s[0]) / points or 1.0
        bucket = np.minimum(((times_s - times_s[0]) / width).astype(np.int64), points - 1)
        starts = np.flatnonzero(np.diff(bucket, prepend=-1))
        ends = np.append(starts[1:], len(times_s)) - 1
        time_s = (times_s[starts] + times_s[ends]) / 2
        low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
        after = after[np.isin(after + 1, starts)]  # a gap inside one bucket is narrower than a point
        last_before = np.searchsorted(starts, after, side="right") - 1
    if len(last_before):
        middle = (times_s[after] + times_s[after + 1]) / 2
        time_s = np.insert(time_s, last_before + 1, middle)
        low = np.insert(low, last_before + 1, np.nan)
        high = np.insert(high, last_before + 1, np.nan)
    return SessionSeries(name, unit, time_s, low, high, gaps)


class SeriesSamples:
    """The (n,) samples of a signal in order of time; signals that were sampled together share the same track."""

    def __init__(self, track: Track, parts: Sequence[tuple[BlockColumn, int]], order: Any) -> None:
        self.track = track
        self._parts = parts
        self._order = order

    @cached_property
    def counts(self) -> CountArray:
        """(n,) values as stored; decoded when first asked for."""
        parts = [column.counts[:, i] for column, i in self._parts]
        return np.concatenate(parts)[self._order] if parts else np.empty(0, np.int64)


@dataclass(frozen=True, slots=True)
class FieldSamples:
    """All elements of a field: (n,) unix times [s] and (n, elements) values in its unit, NaN where not measured."""

    time_s: FloatArray
    values: FloatArray


def joined(tracks: Sequence[Track]) -> tuple[Track, Any]:
    """Tracks behind each other in order of time, and the index that brings their samples into this order."""
    nothing = np.empty(0, np.int64)
    times_us = np.concatenate([nothing, *(track.times_us for track in tracks)])
    instants = np.concatenate([nothing, *(track.instants for track in tracks)])
    if not (np.diff(times_us) < 0).any():
        return Track(times_us, instants), slice(None)
    order = np.argsort(times_us, kind="stable")
    return Track(times_us[order], instants[order]), order
