"""CAN logs of other tools, candump, ASC, BLF, TRC, MF4: as frames, and by a DBC as a table of signals."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import ExtraMissing, ImportFailed
from app.estimation.arrays import FloatArray
from app.sources.recordings.candump import MOST_S, candump_frames
from app.sources.recordings.mf4_log import mf4_frames
from app.sources.recordings.profile import ImportProfile
from app.sources.recordings.table import Table, matching
from app.words import Message, Quantity
from firmware_protocol.memory_map import CAN_ID_EXTENDED

ENDINGS = (".log", ".asc", ".blf", ".trc", ".mf4")
_ID_BITS = 0x1FFFFFFF
_MOST_BYTES = 64  # of CAN FD
Frame = tuple[float, int, bytes]  # unix time or seconds, id with bit 31 for 29-bit ones, data


def read_frames(path: Path) -> Iterator[Frame]:
    """Yield the data frames of a log, in its order.

    Raises:
        ImportFailed: the file cannot be read as what its name says, or tells a time, an id or a length that cannot be.
        ExtraMissing: asammdf, which reads MF4, is not installed.
    """
    for frame in _read(path):
        if not abs(frame[0]) < MOST_S:  # not a number, too
            raise ImportFailed(path.name, Message("no-can-log", error=f"a time of {frame[0]:g} s"))
        if frame[1] & ~(CAN_ID_EXTENDED | _ID_BITS) or len(frame[2]) > _MOST_BYTES:
            error = f"a frame of id {frame[1]:X} and {len(frame[2])} bytes"
            raise ImportFailed(path.name, Message("no-can-log", error=error))
        yield frame


def _read(path: Path) -> Iterator[Frame]:
    if not path.name.lower().endswith(ENDINGS[1:]):
        yield from _candump(path)
        return
    if path.name.lower().endswith(".mf4"):
        try:
            yield from mf4_frames(path)
        except ExtraMissing:
            raise
        except Exception as error:  # asammdf raises what it meets
            raise ImportFailed(path.name, Message("no-can-log", error=str(error))) from error
        return
    can = import_module("can")  # brings the libraries of every format it knows, hundreds of files
    try:
        options = {"relative_timestamp": False} if path.name.lower().endswith(".asc") else {}
        reader: Any = can.LogReader(path, **options)
        with reader:
            for message in reader:
                if not (message.is_error_frame or message.is_remote_frame):
                    extended = CAN_ID_EXTENDED if message.is_extended_id else 0
                    yield float(message.timestamp), message.arbitration_id | extended, bytes(message.data)
    except MemoryError:
        raise
    except Exception as error:  # every reader raises its own: struct.error, BLFParseError, ...
        raise ImportFailed(path.name, Message("no-can-log", error=str(error))) from error


def _candump(path: Path) -> Iterator[Frame]:
    try:
        with path.open(encoding="ascii") as lines:
            yield from candump_frames(lines)
    except (OSError, ValueError) as error:
        raise ImportFailed(path.name, Message("no-can-log", error=str(error))) from error


def signal_table(path: Path, dbc: Path, profile: ImportProfile) -> Table:
    """Return the profile's signals at every frame that carries the current; others as last received.

    Raises:
        ExtraMissing: cantools is not installed.
        ImportFailed: the log or the DBC cannot be read, or a signal is in none of the frames.
    """
    profile.check_complete()
    signals = _signals(read_frames(path), path.name, dbc)
    source = path.name
    times_s, current = _signal(source, "current", profile.current, signals)
    columns: dict[str, FloatArray] = {"time": times_s, profile.current: current}
    indexed = {name.partition("[")[0] for name in (profile.voltages, profile.temperatures) if "[" in name}
    for name, (at_s, values) in signals.items():
        is_wanted = (
            name == profile.soc
            or matching(profile.voltages, [name])
            or matching(profile.temperatures, [name])
            or name.partition("[")[0] in indexed
        )
        if is_wanted and name not in columns:
            columns[name] = _held(times_s, *_in_order(at_s, values), profile.hold_s)
    return Table(source, columns)


def column_profile(profile: ImportProfile) -> dict[str, object]:
    """What differs in the profile of a table that `signal_table` made: a time column, patterns for indexed signals."""
    changed: dict[str, object] = {"time": "time", "time_unit": "s"}
    for field in ("voltages", "temperatures"):
        name, bracket, _ = getattr(profile, field).partition("[")
        if bracket:
            changed[field] = name + "[{n}]"
    return changed


def signal_names(path: Path, dbc: Path) -> list[str]:
    """Return the signals that a log's frames carry by a DBC.

    Raises:
        ExtraMissing: cantools is not installed.
        ImportFailed: the log or the DBC cannot be read.
    """
    return sorted(_signals(read_frames(path), path.name, dbc))


def one_signal(frames: Iterable[Frame], source: str, dbc: Path, name: str) -> tuple[FloatArray, FloatArray]:
    """Return the (n,) times and values of a signal, SIGNAL or MESSAGE.SIGNAL, in frames of `source`.

    Raises:
        ExtraMissing: cantools is not installed.
        ImportFailed: the DBC cannot be read, or the signal is not in it or in no frame.
    """
    signals = _signals(frames, source, dbc, only=name.rpartition(".")[2])
    return _signal(source, "signal", name, signals)


def _signals(
    frames: Iterable[Frame], source: str, dbc: Path, only: str | None = None
) -> dict[str, tuple[list[float], list[float]]]:
    """Times and values of each signal; under its own name where only one message has one of that name.

    With `only`, of messages that have a signal of this name.
    """
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
    signals: dict[str, tuple[list[float], list[float]]] = defaultdict(lambda: ([], []))
    for at_s, can_id, data in frames:
        message = by_id.get(can_id)
        if message is None:
            continue
        try:
            values = message.decode(data, decode_choices=False, allow_truncated=True)
        except Exception as error:
            raise ImportFailed(
                source,
                Message("frame-not-decoded", name=message.name, time=Quantity(at_s, "s", 3), error=str(error)),
            ) from error
        numbers = {name: float(value) for name, value in values.items() if isinstance(value, int | float)}
        for name, value in numbers.items():
            names = [f"{message.name}.{name}"] + ([name] if uses[name] == 1 else [])
            names += [f"{name}[{int(index)}]" for other, index in numbers.items() if _counts(other, name, index)]
            for each in names:
                times, found = signals[each]
                times.append(at_s)
                found.append(value)
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


def _signal(
    source: str, what: str, name: str, signals: dict[str, tuple[list[float], list[float]]]
) -> tuple[FloatArray, FloatArray]:
    if name not in signals:
        shown = tuple(sorted(signals)[:12])
        raise ImportFailed(source, Message("no-frame-carries", what=what, name=repr(name), names=shown))
    return _in_order(*signals[name])


def _in_order(times_s: list[float], values: list[float]) -> tuple[FloatArray, FloatArray]:
    """A log of several buses may tell frames a little late."""
    order = np.argsort(times_s, kind="stable")
    return np.array(times_s)[order], np.array(values)[order]


def _held(times_s: FloatArray, at_s: FloatArray, values: FloatArray, hold_s: float) -> FloatArray:
    """The last value at each time, NaN before the first and where it is older than `hold_s`."""
    index = np.searchsorted(at_s, times_s, side="right") - 1
    found = np.where(index >= 0, values[index], np.nan)
    found[times_s - at_s[index] > hold_s] = np.nan
    return np.asarray(found, np.float64)
