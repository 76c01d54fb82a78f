"""CAN logs of other tools as frames."""

import gzip
import logging
import re
from codecs import BOM_UTF8
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from io import BufferedReader, TextIOWrapper
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from app.errors import ExtraMissing, ImportFailed
from app.sources.recordings.bad_rows import EARLY, BadRows, UnreadableLine
from app.sources.recordings.blf_log import blf_frames, data_frame
from app.sources.recordings.buses import Buses
from app.sources.recordings.clock import LogClock
from app.sources.recordings.kind import CAN_LOGS, kind_of, wide_encoding
from app.sources.recordings.line_logs import MOST_S, candump_frame, crtd_frame, savvycan_frame
from app.sources.recordings.mf4_log import mf4_frames
from app.sources.recordings.table import GZIP_MAGIC, NO_TABLES
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

_ID_BITS = 0x1FFFFFFF
_MOST_BYTES = 64  # data bytes of CAN FD
_READ_AT_ONCE = 1 << 18
_BEGIN = 1 << 12  # bytes that show how a text is encoded
_PROGRESS_EVERY = 500  # frames
Frame = tuple[float, int, bytes]  # unix time or seconds, id with bit 31 for 29-bit ones, data
BusFrame = tuple[float, int, bytes, str]  # and the bus, as the log names it
OnRead = Callable[[int], None]  # bytes of the file that are read
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
