"""Signals of a session as rows: one for every instant at which the master sampled any of them.

Nothing is filled in: a signal that was not sampled at an instant is NaN there. Read piece by piece, so that memory
does not grow with the session.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from app.estimation.arrays import FloatArray
from app.sessions.export.formats import Names
from app.sessions.reading.blocks import Block
from app.sessions.reading.reader import SessionFile
from app.sessions.storage.chunks import ESTIMATES
from app.sessions.storage.signals import Signals, StoredSignal
from app.sources.master.uptime_clock import UptimeClock
from app.sources.recordings.origin import SIMULATED_COLUMN

_INDEX = re.compile(r"\[(\d+)\]")
_NOT_OF_CELLS = "sensor"  # its elements are sensors, also where there are as many as cells


def export_name(signal: StoredSignal, names: Names, signals: Signals, segments: Sequence[int]) -> str:
    """Return a signal's name without its unit.

    Args:
        signal: of `signals`, or one that a table adds.
        names: `index`: `v[36]`, counted from 0; `number`: `v_037`, from 1; `pack`: `pack4_cell1_v`, from 1, and as
            `number` what is not of one cell.
        signals: of the session.
        segments: cells of each pack.
    """
    if names == "index":
        return signal.name
    if names == "pack" and _is_of_a_cell(signal, signals, sum(segments)):
        ends = list(accumulate(segments))
        pack = next(k for k, end in enumerate(ends) if signal.element < end)
        cell = signal.element - ends[pack] + segments[pack]
        return f"pack{pack + 1}_cell{cell + 1}_{_word(signal.field)}"
    return _word(_INDEX.sub(lambda match: f"_{int(match[1]) + 1:03d}", signal.name))


def _is_of_a_cell(signal: StoredSignal, signals: Signals, n_cells: int) -> bool:
    is_one_of_many = signal.field in signals.order and signal.name != signal.field
    return is_one_of_many and signal.field != _NOT_OF_CELLS and signals.of_field(signal.field)[1] == n_cells


def _word(name: str) -> str:
    return name.replace(".", "_")


def column_name(name: str, unit: str) -> str:
    """Return a name with its unit: `v[36] (V)`."""
    return name if unit in ("", "1") else f"{name} ({unit})"


_Instants = tuple[NDArray[np.int64], NDArray[np.int64]]  # times [us] and instants of a track
PIECE_S = 240.0
MARGIN_US = 1_000_000  # what belongs to one instant arrives within this time
_UPTIME = 0xFFFFFFFF  # mask of uptime in an instant; above it is the count of starts
_SAME_S = 1e-4  # resolution of a span: 1 ms
# Columns of every row behind its signals, in this order.
FILLED = StoredSignal("filled", "filled", 0, "", 1.0)  # 1 where the row came from another recorder of the same run
SIMULATED = StoredSignal(SIMULATED_COLUMN, SIMULATED_COLUMN, 0, "", 1.0)  # 1 in every row of a car that was none
AGE = StoredSignal("age", "age", 0, "s", 1e-3)  # how long before its time a row was measured


def source_of(table: "SignalTable") -> dict[str, str]:
    """Return what a format with metadata of its own says of the car: where the session came from, if it is known."""
    source = table.info.metadata.get("source")
    return {"source": source} if isinstance(source, str) else {}


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a table in order of time, n of k signals."""

    time_s: FloatArray  # (n,) since 1970 UTC
    elapsed_s: FloatArray  # (n,) since the session's start, on the monotonic clock
    uptime_s: FloatArray  # (n,) the master's clock, NaN where it has no part in it
    time_us: NDArray[np.int64]  # (n,) since 1970 UTC, each later than the one before
    values: NDArray[Any]  # (n, k) in the signals' units, NaN where not sampled or not measured


class SignalTable:
    """Some signals over a range; without `signals` the default ones that the session holds.

    Behind them stand FILLED where gaps of the session were filled from another recorder, SIMULATED where the car was
    simulated, and AGE: what waited on its way to the recorder is old at its `time_s`; beyond 1 s it was not live.
    A battery with a DBC has a row a period of its profile, each value the newest that is not too old, and no AGE.
    """

    def __init__(
        self,
        session: SessionFile,
        signals: Sequence[str] | None = None,
        t_from_s: float | None = None,
        t_to_s: float | None = None,
        *,
        lap_times_s: Sequence[float] | None = None,
        names: Names = "index",
        on_progress: Callable[[int, int], None] = lambda done, of: None,
    ) -> None:
        """Choose signals and range, both ends included; `lap_times_s` are where laps meet, for formats with laps.

        `names` are what `export_name` knows; `on_progress` gets how much of how much is read.

        Raises:
            UnknownSignal: a name means nothing.
        """
        self.session = session
        self.on_progress = on_progress
        if signals:
            self.signals = [session.signals.find(name) for name in dict.fromkeys(signals)]
        else:
            present = set(session.signal_names())
            self.signals = [s for s in session.signals.of_table() if s.field in present]
        self._of_field: dict[str, list[int]] = defaultdict(list)  # indices of its signals
        for i, signal in enumerate(self.signals):
            self._of_field[signal.field].append(i)
        self._filled = session.filled()
        self.info = session.info
        self.is_simulated = self.info.metadata.get("source") == "simulator"
        self._added = [
            *([FILLED] if self._filled else []),
            *([SIMULATED] if self.is_simulated else []),
            *([AGE] if session.loaded_battery.has_memory_map else []),
        ]
        self.signals = [*self.signals, *self._added]
        self.t_from_s, self.t_to_s = t_from_s, t_to_s
        self.lap_times_s = lap_times_s
        segments = session.loaded_battery.battery.segments
        self.names = [export_name(signal, names, session.signals, segments) for signal in self.signals]
        self.columns = self.names  # in a table of text, which has no other place for a unit
        if names == "index":
            self.columns = [column_name(s.name, s.unit) for s in self.signals]

    def rows(self, piece_s: float | None = None, dtype: DTypeLike = np.float64) -> Iterator[Rows]:
        """Yield the rows, PIECE_S at a time by default; values as `dtype`."""
        piece_us = round((PIECE_S if piece_s is None else piece_s) * 1e6)
        start_us = self.info.started_mono_ns // 1000
        first_us, last_us = self._range_us(start_us)
        margin_s = MARGIN_US / 1e6
        ends_s = self.session.unix_s(first_us * 1000) - margin_s, self.session.unix_s(last_us * 1000) + margin_s
        blocks = self.session.blocks([s for s in self.signals if s not in self._added], *ends_s, in_rows=True)
        uptime_clock = UptimeClock()
        for arrived_ns, uptime_ms in self.session.uptimes(first_us * 1000):
            uptime_clock.measured_ns(uptime_ms, arrived_ns)
        held: list[Block] = []
        upcoming = next(blocks, None)
        last_time_us = np.iinfo(np.int64).min // 2
        begin_us = first_us
        while first_us <= last_us:
            end_us = min(first_us + piece_us, last_us + 1)
            while upcoming is not None and upcoming.first_us <= end_us + MARGIN_US:
                held.append(upcoming)
                upcoming = next(blocks, None)
            held = [block for block in held if block.last_us >= first_us - MARGIN_US]
            rows = self._rows(held, first_us, end_us, start_us, uptime_clock, dtype)
            if len(rows.time_s):
                rows = replace(rows, time_us=_one_after_another(rows.time_us, last_time_us))
                last_time_us = int(rows.time_us[-1])
                yield rows
            first_us = end_us
            self.on_progress(first_us - begin_us, last_us + 1 - begin_us)

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

    def constant(self, signal: StoredSignal, time_s: FloatArray) -> FloatArray:
        """Return (n,) values of FILLED or SIMULATED."""
        return self.is_filled(time_s) if signal is FILLED else np.ones(len(time_s))

    def _rows(
        self,
        blocks: Sequence[Block],
        first_us: int,
        end_us: int,
        start_us: int,
        uptime_clock: UptimeClock,
        dtype: DTypeLike,
    ) -> Rows:
        """Rows whose time is within [first_us, end_us).

        Samples of one instant that arrived on both sides of an end meet in one row, because the rows on both sides look
        beyond it and agree on the row's time.
        """
        columns = [column for block in blocks for column in block.columns]
        tracks = {id(column.track): column.track for column in columns}
        ends_us = (first_us - MARGIN_US, end_us + MARGIN_US + 1)
        spans = {key: slice(*np.searchsorted(track.times_us, ends_us)) for key, track in tracks.items()}
        of_estimates = {id(column.track) for column in columns if column.field in ESTIMATES}
        parts = [(tracks[key].times_us[span], tracks[key].instants[span]) for key, span in spans.items()]
        parts = _with_their_samples(parts, [key in of_estimates for key in spans])
        nothing = np.empty(0, np.int64)
        times_us, instants = (np.concatenate(columns) for columns in zip((nothing, nothing), *parts, strict=True))
        instants, row_of_sample = np.unique(instants, return_inverse=True)
        row_us = np.full(len(instants), np.iinfo(np.int64).max)
        np.minimum.at(row_us, row_of_sample, times_us)
        rows_of = dict(zip(spans, np.split(row_of_sample, np.cumsum([len(part[0]) for part in parts])), strict=False))
        values = np.full((len(self.signals), len(instants)), np.nan, dtype)
        for column in columns:
            key = id(column.track)
            wanted = self._of_field[column.field]
            elements = np.array([self.signals[i].element for i in wanted])
            at = np.minimum(np.searchsorted(column.elements, elements), len(column.elements) - 1)
            is_here = column.elements[at] == elements
            counts = column.counts[spans[key], at[is_here]]
            in_units = self.signals[wanted[0]].physical(counts).T
            rows = _as_slice(rows_of[key])
            for i, of_signal in zip(np.array(wanted)[is_here].tolist(), in_units, strict=True):
                values[i, rows] = of_signal
        order = np.argsort(row_us, kind="stable")
        order = order[(row_us[order] >= first_us) & (row_us[order] < end_us)]
        uptime_s = np.where(instants[order] >= 0, (instants[order] & 0xFFFFFFFF) / 1000, np.nan)
        elapsed_s = (row_us[order] - start_us) / 1e6
        started_s = self.session.unix_s(start_us * 1000)
        time_s, values = started_s + elapsed_s, values[:, _as_slice(order)]
        time_us = round(started_s * 1e6) + (row_us[order] - start_us)
        for i, signal in enumerate(self._added, start=len(values) - len(self._added)):
            is_age = signal is AGE
            values[i] = (
                _ages_s(row_us[order], instants[order], uptime_clock) if is_age else self.constant(signal, time_s)
            )
        return Rows(time_s, elapsed_s, uptime_s, time_us, values.T)


def _with_their_samples(parts: Sequence[_Instants], are_estimates: Sequence[bool]) -> list[_Instants]:
    """Return the parts, each estimate with the instant of the sample that it was made from.

    Where a chunk ended between the two and the master started anew, only the sample knows which start it is of.
    """
    of_master = np.concatenate([np.empty(0, np.int64), *(instants[instants >= 0] for _, instants in parts)])
    if not len(of_master) or of_master.min() >> 32 == of_master.max() >> 32:
        return list(parts)
    samples = (part for part, is_estimate in zip(parts, are_estimates, strict=True) if not is_estimate)
    instant_of = {(time_us, instant & _UPTIME): instant for part in samples for time_us, instant in _pairs(part)}
    return [
        (
            part[0],
            np.array(
                [instant_of.get((time_us, instant & _UPTIME), instant) for time_us, instant in _pairs(part)], np.int64
            ),
        )
        if is_estimate
        else part
        for part, is_estimate in zip(parts, are_estimates, strict=True)
    ]


def _pairs(part: _Instants) -> Iterator[tuple[int, int]]:
    return zip(part[0].tolist(), part[1].tolist(), strict=True)


def _ages_s(row_us: NDArray[np.int64], instants: NDArray[np.int64], uptime_clock: UptimeClock) -> FloatArray:
    """Return (n,) how long before it arrived each row was measured, NaN where the master's clock has no part in it."""
    ages_s = np.full(len(row_us), np.nan)
    has_part = instants >= 0
    arrived_us = row_us[has_part]
    measured_ns = uptime_clock.all_measured_ns(instants[has_part] & 0xFFFFFFFF, arrived_us * 1000)
    ages_s[has_part] = arrived_us / 1e6 - measured_ns / 1e9
    return ages_s


def _one_after_another(times_us: NDArray[np.int64], last_us: int) -> NDArray[np.int64]:
    """Return ascending times, what does not come after the one before put 1 us after it; `last_us` is before all."""
    places = np.arange(len(times_us))
    return np.maximum.accumulate(np.maximum(times_us - places, last_us + 1)) + places


def _as_slice(index: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """The same index as a slice where it is one row after the other: far quicker."""
    is_slice = len(index) > 0 and index[-1] - index[0] == len(index) - 1 and (np.diff(index) == 1).all()
    return slice(int(index[0]), int(index[-1]) + 1) if is_slice else index


@dataclass(frozen=True, slots=True, order=True)
class LogLine:
    """An event or a marker."""

    t_mono_ns: int
    severity: str  # severity of an event; "" of a marker
    name: str  # an event's code, or a marker's kind
    text: str


def log_lines(table: SignalTable) -> list[LogLine]:
    """Return what happened in the range of a table, in order of time."""
    session = table.session
    lines = [
        LogLine(event["t_mono_ns"], str(event["severity"]), str(event["code"]), str(event["text"]))
        for event in session.events()
    ]
    lines += [LogLine(marker.t_mono_ns, "", marker.kind, marker.text) for marker in session.markers()]
    first_s, last_s = table.t_from_s or 0.0, np.inf if table.t_to_s is None else table.t_to_s
    return sorted(line for line in lines if first_s <= session.unix_s(line.t_mono_ns) <= last_s)
