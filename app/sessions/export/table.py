"""Signals of a session as rows: one for every instant at which the master sampled any of them.

Nothing is filled in: a signal that was not sampled at an instant is NaN there. Read piece by piece, so that memory
does not grow with the session.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.sessions.reading.reader import SessionFile
from app.sessions.storage.signals import Signal, default_signals, find_signal

FloatArray = NDArray[np.float64]
BLOCK_S = 240.0
_MARGIN_S = 1.0  # what belongs to one instant arrives within this time
_SAME_S = 1e-4  # a span is told to the millisecond
FILLED = Signal("filled", "filled", 0, "", 1.0)  # 1 where the row came from another recorder of the same run


def column_name(signal: Signal) -> str:
    """Return the signal's name with its unit: `v[36] (V)`."""
    return signal.name if signal.unit in ("", "1") else f"{signal.name} ({signal.unit})"


@dataclass(frozen=True, slots=True)
class Block:
    """Rows of a table in order of time, n of k signals."""

    time_s: FloatArray  # (n,) since 1970 UTC
    elapsed_s: FloatArray  # (n,) since the session's start, on the monotonic clock
    uptime_s: FloatArray  # (n,) the master's clock, NaN where it has no part in it
    values: FloatArray  # (n, k) in the signals' units, NaN where not sampled or not measured


class SignalTable:
    """Some signals over a range; without `signals` the default ones that the session holds.

    Where gaps of the session were filled from another recorder the last signal is FILLED.
    """

    def __init__(
        self,
        session: SessionFile,
        signals: Sequence[str] | None = None,
        t_from_s: float | None = None,
        t_to_s: float | None = None,
        *,
        lap_times_s: Sequence[float] | None = None,
    ) -> None:
        """Choose signals and range, both ends included; `lap_times_s` are where laps meet, for formats with laps.

        Raises:
            UnknownSignal: a name means nothing.
        """
        self.session = session
        if signals:
            self.signals = [find_signal(name) for name in dict.fromkeys(signals)]
        else:
            present = set(session.signal_names())
            self.signals = [s for s in map(find_signal, default_signals()) if s.field in present]
        self._filled = session.filled()
        self._recorded = self.signals
        if self._filled:
            self.signals = [*self.signals, FILLED]
        self.info = session.info
        self.t_from_s, self.t_to_s = t_from_s, t_to_s
        self.lap_times_s = lap_times_s

    def blocks(self) -> Iterator[Block]:
        """Yield the rows."""
        start_us = self.info.started_mono_ns // 1000
        first_us, last_us = self._range_us(start_us)
        while first_us <= last_us:
            end_us = min(first_us + round(BLOCK_S * 1e6), last_us + 1)
            block = self._block(first_us, end_us, start_us)
            if len(block.time_s):
                yield block
            first_us = end_us

    def is_filled(self, time_s: FloatArray) -> FloatArray:
        """Return (n,) 1 where a time lies in a gap that was filled, else 0."""
        inside = np.zeros(len(time_s))
        for first_s, last_s in self._filled:
            inside[(time_s >= first_s - _SAME_S) & (time_s <= last_s + _SAME_S)] = 1.0
        return inside

    def _range_us(self, start_us: int) -> tuple[int, int]:
        spans = self.session.chunk_spans_us()
        first_us = min([span[0] for span in spans], default=start_us)
        last_us = max([span[1] for span in spans], default=start_us - 1)
        if any(signal.field.startswith("conf.") for signal in self.signals):
            first_us, last_us = min(first_us, start_us), max(last_us, (self.info.ended_mono_ns or 0) // 1000)
        if self.t_from_s is not None:
            first_us = max(first_us, self.session.mono_us(self.t_from_s))
        if self.t_to_s is not None:
            last_us = min(last_us, self.session.mono_us(self.t_to_s))
        return first_us, last_us

    def _block(self, first_us: int, end_us: int, start_us: int) -> Block:
        """Rows whose time is within [first_us, end_us).

        Samples of one instant that arrived on both sides of an end meet in one row, because both blocks look beyond
        their ends and agree on the row's time.
        """
        low_s = self.session.unix_s(first_us * 1000) - _MARGIN_S
        high_s = self.session.unix_s(end_us * 1000) + _MARGIN_S
        with self.session.consistent():
            samples = [self.session.samples(signal, low_s, high_s, instants=True) for signal in self._recorded]
        found = np.concatenate([np.empty(0, np.int64), *(s.instants for s in samples if s.instants is not None)])
        if not len(found):
            empty = np.empty(0)
            return Block(empty, empty, empty, np.empty((0, len(self.signals))))
        instants, rows = np.unique(found, return_inverse=True)
        row_us = np.full(len(instants), np.iinfo(np.int64).max)
        np.minimum.at(row_us, rows, np.concatenate([s.times_us for s in samples]))
        values = np.full((len(instants), len(samples)), np.nan)
        position = 0
        for column, (signal, of_signal) in enumerate(zip(self._recorded, samples, strict=True)):
            end = position + len(of_signal.times_us)
            values[rows[position:end], column] = signal.physical(of_signal.counts)
            position = end
        order = np.argsort(row_us, kind="stable")
        order = order[(row_us[order] >= first_us) & (row_us[order] < end_us)]
        uptime_s = np.where(instants[order] >= 0, (instants[order] & 0xFFFFFFFF) / 1000, np.nan)
        elapsed_s = (row_us[order] - start_us) / 1e6
        time_s, values = self.session.unix_s(start_us * 1000) + elapsed_s, values[order]
        if self._filled:
            values = np.column_stack((values, self.is_filled(time_s)))
        return Block(time_s, elapsed_s, uptime_s, values)
