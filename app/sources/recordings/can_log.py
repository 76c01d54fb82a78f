"""CAN logs of other tools as frames, and by a DBC as a table of signals."""

import gzip
import logging
import re
from array import array
from codecs import BOM_UTF8
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from io import BufferedReader, TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TextIO

import numpy as np

from app.errors import ExtraMissing, ImportFailed, LimitExceeded
from app.estimation.arrays import FloatArray, latest_at
from app.sources.recordings.bad_rows import EARLY, SHOWN_TEXT, BadRows, UnreadableLine
from app.sources.recordings.blf_log import blf_frames, data_frame
from app.sources.recordings.buses import Buses
from app.sources.recordings.clock import LogClock
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.kind import CAN_LOGS, kind_of, wide_encoding
from app.sources.recordings.line_logs import MOST_S, candump_frame, crtd_frame, savvycan_frame
from app.sources.recordings.mf4_log import mf4_frames
from app.sources.recordings.table import GZIP_MAGIC, NO_TABLES, Table, matching
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

_ID_BITS = 0x1FFFFFFF
_MOST_BYTES = 64  # data bytes of CAN FD
_READ_AT_ONCE = 1 << 18
_BEGIN = 1 << 12  # bytes that show how a text is encoded
_PROGRESS_EVERY = 500  # frames
MOST_VALUES = 16_000_000  # values of signals by a DBC: each takes 38 bytes until the table is made
Frame = tuple[float, int, bytes]  # unix time or seconds, id with bit 31 for 29-bit ones, data
BusFrame = tuple[float, int, bytes, str]  # and the bus, as the log names it
OnRead = Callable[[int], None]  # bytes of the file that are read
Signals = dict[str, tuple["array[float]", "array[float]"]]  # times and values by name
_HEADER = (
    ";",
    "date",
    "base",
    "internal",
    "no internal",
    "//",
    "Begin",
    "begin",
)  # first words of header lines of .trc and .asc
_RELATIVE = re.compile(r"\s*\d+\.\d+(?=\s)")
_LINE_LOGS = {"candump": candump_frame, "savvycan": savvycan_frame, "crtd": crtd_frame}


def read_frames(
    path: Path,
    bad: BadRows | None = None,
    on_read: OnRead | None = None,
    clock: LogClock | None = None,
    buses: Buses | None = None,
) -> Iterator[Frame]:
    """Yield the data frames of a log, in its order; what it is is taken from its content.

    Args:
        path: candump, SavvyCAN, CRTD, .asc, .trc, .blf or MF4 bus logging; text also gzip.
        bad: gets the lines and frames that cannot be read.
        clock: gets what the log's clock did; a clock that starts again, or is set, makes no jump.
        on_read: given how many bytes are read, again and again; not of MF4.
        buses: says which bus is read, and gets the ids of all; whoever decodes them calls its `check`.

    Raises:
        ImportFailed: it cannot be read, or more than half of it cannot.
        ExtraMissing: asammdf, which reads MF4, is not installed.
    """
    kind, counted = kind_of(path), [0]
    bad = BadRows() if bad is None else bad
    clock = LogClock() if clock is None else clock
    if kind not in CAN_LOGS:
        why = NO_TABLES[kind] if kind == "candump-no-time" else Message("no-can-log", error=Message("no-log-kind"))
        raise ImportFailed(path.name, why)
    try:
        with path.open("rb", _READ_AT_ONCE) as file:
            clock.may_be_differences, clock.has_lines = kind == "candump", kind in _LINE_LOGS
            frames = _frames(kind, path, file, bad, clock)
            usable = _usable(frames, file, bad, counted, on_read)
            kept = usable if buses is None else (frame for frame in usable if buses.keeps(frame[3], frame[1]))
            yield from clock.in_time(path.name, (frame[:3] for frame in kept))
    except (ExtraMissing, ImportFailed, MemoryError):
        raise
    except Exception as error:  # every reader raises its own: struct.error, MdfException, ...
        raise ImportFailed(path.name, Message("no-can-log", error=str(error))) from error
    if on_read is not None and kind != "mf4":
        on_read(path.stat().st_size)
    bad.check(path.name, counted[0])


def _usable(
    frames: Iterator[BusFrame], file: BinaryIO, bad: BadRows, counted: list[int], on_read: OnRead | None
) -> Iterator[BusFrame]:
    """The frames whose time, id and length can be; `counted` gets their number."""
    for number, frame in enumerate(frames):
        if on_read is not None and number % _PROGRESS_EVERY == 0:
            on_read(file.tell())
        if not abs(frame[0]) < MOST_S:  # not a number, too
            bad.add(None, Message("odd-time", time=f"{frame[0]:g}"))
        elif frame[1] & ~(CAN_ID_EXTENDED | _ID_BITS) or len(frame[2]) > _MOST_BYTES:
            bad.add(None, Message("odd-frame", id=f"{frame[1]:X}", bytes=len(frame[2])))
        else:
            counted[0] += 1
            yield frame
        if bad.count > EARLY and not counted[0]:
            break


def _frames(kind: str, path: Path, file: Any, bad: BadRows, clock: LogClock) -> Iterator[BusFrame]:
    """The frames of a log; one that is text may be packed."""
    if kind == "mf4":
        return mf4_frames(path)
    if kind == "blf":
        return blf_frames(file, bad)
    is_packed = file.peek(2)[:2] == GZIP_MAGIC
    plain: Any = BufferedReader(gzip.GzipFile(fileobj=file)) if is_packed else file
    begin = plain.peek(_BEGIN)
    if begin.startswith(BOM_UTF8):
        plain.read(len(BOM_UTF8))
    text = TextIOWrapper(plain, encoding=wide_encoding(begin[:_BEGIN]) or "latin-1")
    if kind in _LINE_LOGS:
        return _lines(text, _LINE_LOGS[kind], bad, clock)
    return _text_of_python_can(text, kind, bad)


def _lines(
    text: TextIO, frame_of: Callable[[str], BusFrame | None], bad: BadRows, clock: LogClock
) -> Iterator[BusFrame]:
    """The frames of a log that has one a line; a last line without its end may be cut off."""
    good = 0
    with text:
        for number, whole in enumerate(text, 1):
            frame, line = None, whole
            if "\0" in line:  # the power went away while a block of the file was written
                bad.add(number, Message("nul-bytes", n=line.count("\0")))
                line = line.strip("\0")
            try:
                frame = frame_of(line) if line.strip() else None
            except UnreadableLine as error:
                if line.endswith("\n"):
                    bad.add(number, error.why)
            if frame is None:
                clock.lines_left_out.append(good)
            else:
                good += 1
                yield frame


class _Lines:
    """The lines of a text file for a reader of python-can, which begins again behind one that it cannot read."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._header: list[str] = []  # the header, for each reader that follows
        self._repeated: list[str] = []
        self._in_header = True
        self._sum_s: float | None = None  # time of an .asc with relative times: each line's is since the one before
        self.number = 0

    def __iter__(self) -> Iterator[str]:
        while self._repeated:
            yield self._repeated.pop(0)
        for line in self._file:
            self.number += 1
            self._in_header &= line.startswith(_HEADER) or not line.strip()
            if self._in_header:
                self._header.append(line)
                if "timestamps relative" in line:
                    self._sum_s = 0.0
            yield line if self._sum_s is None else self._absolute(line)

    def _absolute(self, line: str) -> str:
        match = _RELATIVE.match(line)
        if match is None:
            return line
        self._sum_s = (self._sum_s or 0.0) + float(match[0])
        return f"{self._sum_s:.6f}{line[match.end() :]}"

    def repeat_header(self) -> None:
        self._repeated = list(self._header)

    def readline(self) -> str:
        return next(iter(self), "")

    def read(self, size: int = -1) -> str:
        raise NotImplementedError

    def write(self, text: str) -> int:
        raise NotImplementedError

    def close(self) -> None:
        self._file.close()


@contextmanager
def _warnings_as_bad_lines(bad: BadRows, lines: _Lines) -> Iterator[None]:
    """Count the lines that python-can leaves out with a warning each."""
    logger = logging.getLogger("can.io")

    def count(record: logging.LogRecord) -> bool:
        bad.add(lines.number, record.getMessage())
        return False

    handler = logging.NullHandler()
    handler.addFilter(count)
    propagates, logger.propagate = logger.propagate, False
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagates


def _text_of_python_can(text: TextIO, kind: str, bad: BadRows) -> Iterator[BusFrame]:
    can = import_module("can")  # brings the libraries of every format it knows, hundreds of files
    is_done, lines = False, _Lines(text)
    with text:
        while not is_done:
            reader: Any = can.TRCReader(lines) if kind == "trc" else can.ASCReader(lines, relative_timestamp=False)
            before = lines.number
            try:
                with _warnings_as_bad_lines(bad, lines):
                    for message in reader:
                        yield from data_frame(message)
                is_done = True
            except MemoryError:
                raise
            except Exception as error:  # ValueError, IndexError, KeyError, ...
                if lines.number == before:
                    raise
                bad.add(lines.number, str(error) or type(error).__name__)
                lines.repeat_header()


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
