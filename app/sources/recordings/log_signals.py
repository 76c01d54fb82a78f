"""CAN logs by a DBC: what their frames carry, as a table of signals."""

from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from app.errors import ExtraMissing, ImportFailed, LimitExceeded
from app.estimation.arrays import FloatArray, latest_at
from app.sources.recordings.bad_rows import SHOWN_TEXT, BadRows
from app.sources.recordings.buses import Buses
from app.sources.recordings.can_log import Frame, OnRead, read_frames
from app.sources.recordings.clock import LogClock
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.table import Table, matching
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

MOST_VALUES = 16_000_000  # values of signals by a DBC: each takes 38 bytes until the table is made
Signals = dict[str, tuple["array[float]", "array[float]"]]  # times and values by name


class LogSignals(NamedTuple):
    """The signals of a log, decoded by a DBC."""

    source: str
    by_name: Signals  # times [s] and values by name
    notes: tuple[Message, ...]  # what could not be read

    def table(self, mapping: ImportMapping) -> Table:
        """Return the profile's signals at every frame that carries the current; others as last received.

        Raises:
            ImportFailed: too little is named, or a signal is in none of the frames.
        """
        mapping.check_complete(self.source, sorted(self.by_name))
        times_s, current = _signal(self.source, "current", mapping.current, self.by_name)
        columns: dict[str, FloatArray] = {"time": times_s, mapping.current: current}
        indexed = {name.partition("[")[0] for name in (mapping.voltages, mapping.temperatures) if "[" in name}
        for name, (at_s, values) in self.by_name.items():
            is_wanted = (
                name == mapping.soc
                or matching(mapping.voltages, [name])
                or matching(mapping.temperatures, [name])
                or name.partition("[")[0] in indexed
            )
            if is_wanted and name not in columns:
                columns[name] = _held(times_s, *_in_order(at_s, values), mapping.hold_s)
        return Table(self.source, columns, notes=self.notes)


def read_signals(
    path: Path,
    dbc: Path,
    most: int | None = None,
    on_read: OnRead | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    clock: LogClock | None = None,
    bus: str = "",
) -> LogSignals:
    """Return the signals in a log's frames; of the first `most` frames where it is given.

    `on_read` gets the bytes read so far, repeatedly; `on_frame` gets every frame; `clock` as for `read_frames`; `bus`
    is the one that is read.

    Raises:
        ExtraMissing: cantools is not installed.
        ImportFailed: the log or the DBC cannot be read.
    """
    unread, undecoded = BadRows(), BadRows(Message("frames-of-dbc"))
    clock = LogClock() if clock is None else clock
    buses = Buses(bus)
    frames = islice(read_frames(path, unread, on_read, clock, buses), most)
    if on_frame is not None:
        frames = (on_frame(frame) or frame for frame in frames)  # type: ignore[assignment]
    signals = _signals(frames, path.name, dbc, bad=undecoded, buses=buses)
    decoded = max((len(times) for times, _ in signals.values()), default=0)
    return LogSignals(path.name, signals, (*unread.notes(decoded), *undecoded.notes(decoded), *clock.notes))


def column_mapping(mapping: ImportMapping) -> dict[str, object]:
    """Return the changes to the profile of a table of `LogSignals`: a time column, patterns for indexed signals."""
    changed: dict[str, object] = {"time": "time", "time_unit": "s"}
    for field in ("voltages", "temperatures"):
        name, bracket, _ = getattr(mapping, field).partition("[")
        if bracket:
            changed[field] = name + "[{n}]"
    return changed


def one_signal(frames: Iterable[Frame], source: str, dbc: Path, name: str) -> tuple[FloatArray, FloatArray]:
    """Return the (n,) times and values of a signal, SIGNAL or MESSAGE.SIGNAL, in frames of `source`.

    Raises:
        ExtraMissing: cantools is not installed.
        ImportFailed: the DBC cannot be read, or the signal is not in it or in no frame.
    """
    signals = _signals(frames, source, dbc, only=name.rpartition(".")[2])
    return _signal(source, "signal", name, signals)


def _signals(
    frames: Iterable[Frame],
    source: str,
    dbc: Path,
    only: str | None = None,
    bad: BadRows | None = None,
    buses: Buses | None = None,
) -> Signals:
    """Times and values of each signal; under its own name where only one message has one of that name.

    With `only`, of messages that have a signal of this name.
    """
    bad = BadRows(Message("frames-of-dbc")) if bad is None else bad
    decoded, kept = 0, 0
    database = _database(dbc)
    by_id = {
        m.frame_id | (CAN_ID_EXTENDED if m.is_extended_frame else 0): m
        for m in database.messages
        if only is None or any(signal.name == only for signal in m.signals)
    }
    uses: dict[str, int] = defaultdict(int)
    for message in database.messages:
        for signal in message.signals:
            uses[signal.name] += 1
    signals: Signals = defaultdict(lambda: (array("d"), array("d")))
    for at_s, can_id, data in frames:
        message = by_id.get(can_id)
        if message is None:
            continue
        try:
            values = message.decode(data, decode_choices=False, allow_truncated=True)
        except Exception as error:  # noqa: BLE001  cantools raises its own, bitstruct's and the codec's
            bad.add(None, Message("undecoded", message=message.name, at=f"{at_s:.3f}", error=str(error)[:SHOWN_TEXT]))
            continue
        decoded += 1
        numbers = {name: float(value) for name, value in values.items() if isinstance(value, int | float)}
        for name, value in numbers.items():
            whole = f"{message.name}.{name}"
            if uses[name] == 1:
                signals[name] = signals[whole]  # by both names the same values
            names = [
                whole,
                *(f"{name}[{int(index)}]" for other, index in numbers.items() if _counts(other, name, index)),
            ]
            kept += len(names)
            for key in names:
                times, samples = signals[key]
                times.append(at_s)
                samples.append(value)
        if kept > MOST_VALUES:
            raise LimitExceeded(Message("limit-signals", limit=MOST_VALUES))
    if buses is not None:
        buses.check(source, by_id)
    bad.check(source, decoded)
    if not signals:
        if only is None:
            raise ImportFailed(source, Message("no-frame-in-dbc", dbc=dbc.name))
        raise ImportFailed(source, Message("no-signal-in-dbc", signal=only, dbc=dbc.name))
    return signals


def _counts(name: str, of: str, value: float) -> bool:
    """Whether a signal can tell which cell another one of its message belongs to."""
    return name != of and name.lower().endswith(("id", "index", "number", "num")) and 0 <= value < 256


def _database(path: Path) -> Any:
    try:
        cantools = import_module("cantools")
    except ImportError as error:
        raise ExtraMissing("a DBC", "cantools", "dbc") from error
    try:
        return cantools.database.load_file(path, database_format="dbc", strict=False)
    except Exception as error:
        raise ImportFailed(path.name, Message("no-dbc", error=str(error))) from error


def _signal(source: str, what: str, name: str, signals: Signals) -> tuple[FloatArray, FloatArray]:
    if name not in signals:
        shown = tuple(sorted(signals)[:12])
        raise ImportFailed(source, Message("no-frame-carries", what=what, name=repr(name), names=shown))
    return _in_order(*signals[name])


def _in_order(times_s: "array[float]", values: "array[float]") -> tuple[FloatArray, FloatArray]:
    """A log of several buses may tell frames a little late."""
    order = np.argsort(times_s, kind="stable")
    return np.array(times_s)[order], np.array(values)[order]


def _held(times_s: FloatArray, at_s: FloatArray, values: FloatArray, hold_s: float) -> FloatArray:
    """The last value at each time, NaN before the first and where it is older than `hold_s`."""
    return np.where(times_s - latest_at(times_s, at_s, at_s) <= hold_s, latest_at(times_s, at_s, values), np.nan)
