"""Samples of signals and fields as arrays, joined from the blocks of a session."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from app.estimation.arrays import FloatArray
from app.sessions.reading.blocks import Column
from app.sessions.storage.chunks import Track
from app.sessions.storage.streams import CountArray


class Samples:
    """The (n,) samples of a signal in order of time; signals that were sampled together share the same track."""

    def __init__(self, track: Track, parts: Sequence[tuple[Column, int]], order: Any) -> None:
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
