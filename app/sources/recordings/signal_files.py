"""Tables out of files that hold signals, not rows: MDF 4, MCAP and MoTeC's .ld, as `voltwall export` writes them.

Files of ours get the columns that begin our CSV exports, so that they are known again; MDF 4 and .ld of others are read
too, at the times of their quickest group of channels, the others as last received.
"""

import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable
from datetime import UTC, date, datetime, time, timedelta
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import AppError, ExtraMissing, LimitExceeded
from app.estimation.arrays import FloatArray, latest_at
from app.sources.recordings.csv_table import TableUnreadable
from app.words import Message, Quantity

Columns = dict[str, FloatArray]
_OURS = "voltwall"
_LD_HEADER = struct.Struct("<I4xI")
_LD_CHANNEL = struct.Struct("<4I4H4h32s8s12s")
_LD_DATE_AT, _LD_TIME_AT, _LD_COMMENT_AT = 94, 126, 1572
_LD_TYPES = {(7, 4): "<f4", (7, 2): "<f2", (0, 2): "<i2", (3, 2): "<i2", (5, 2): "<i2", (0, 4): "<i4", (3, 4): "<i4"}
_LD_TYPES[5, 4] = "<i4"


def read_signals(path: Path, kind: str) -> Columns:
    """Return the (n,) columns of a file of signals by name, with the unit in brackets, the time first.

    Args:
        path: the file.
        kind: "mf4", "mcap" or "ld".

    Raises:
        TableUnreadable: it cannot be read, or no signal is in it.
        ExtraMissing: a library that it needs is not installed.
    """
    readers: dict[str, Callable[[Path], tuple[FloatArray, Columns, bool]]] = {"mf4": _mf4, "mcap": _mcap, "ld": _ld}
    try:
        time_s, columns, is_ours = readers[kind](path)
    except (AppError, MemoryError):
        raise
    except Exception as error:  # each library has errors of many kinds
        raise TableUnreadable(path.name, Message("cannot-be-read", error=str(error))) from error
    if not len(time_s) or not columns:
        raise TableUnreadable(path.name, Message("no-signals"))
    columns.pop("time_s", None)
    if not is_ours:
        return {"time_s": time_s, **columns}
    uptime = columns.pop("uptime_s", columns.pop("uptime_s (s)", np.full(len(time_s), np.nan)))
    return {"time_s": time_s, "elapsed_s": time_s - time_s[0], "uptime_s": uptime, **columns}


def _mf4(path: Path) -> tuple[FloatArray, Columns, bool]:
    try:
        asammdf = import_module("asammdf")
    except ImportError as error:
        raise ExtraMissing("an MF4 file", "asammdf", "mf4") from error
    signals: dict[str, tuple[FloatArray, FloatArray]] = {}
    with path.open("rb") as raw, asammdf.MDF(raw) as file:  # it does not close a file that it cannot read
        start_s = file.start_time.timestamp()
        is_ours = _OURS in (file.header.comment or "")
        for signal in file.iter_channels(skip_master=True):
            values = signal.samples
            if values.ndim == 1 and values.dtype.kind in "biuf" and len(values):
                signals[_with_unit(signal.name, signal.unit)] = (signal.timestamps + start_s, values.astype(np.float64))
    if not signals:
        return np.array([]), {}, is_ours
    time_s = max((times for times, _ in signals.values()), key=len)
    return time_s, {name: latest_at(time_s, *samples) for name, samples in signals.items()}, is_ours


def _mcap(path: Path) -> tuple[FloatArray, Columns, bool]:
    try:
        reader = import_module("mcap.reader")
        classes = _message_classes(import_module("google.protobuf.message_factory"))
    except ImportError as error:
        raise ExtraMissing("an MCAP file", "mcap and protobuf", "mcap") from error
    signals: dict[str, dict[int, float]] = {}
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            if schema is None or schema.name not in ("voltwall.Number", "voltwall.Numbers"):
                continue
            sample = classes(schema).FromString(message.data)
            name = channel.topic.removeprefix("/")
            is_array = schema.name.endswith("s")
            for index, value in enumerate(sample.value if is_array else [sample.value]):
                column = _with_unit(f"{name}[{index}]" if is_array else name, sample.unit)
                signals.setdefault(column, {})[message.log_time] = value
            signals.setdefault("uptime_s", {})[message.log_time] = sample.uptime_s
    times = np.array(sorted({time for values in signals.values() for time in values}), np.int64)
    columns = {}
    for name, values in signals.items():
        columns[name] = np.full(len(times), np.nan)
        columns[name][np.searchsorted(times, list(values))] = list(values.values())
    return times / 1e9, columns, True


def _message_classes(factory: Any) -> Callable[[Any], Any]:
    """A function that returns the class of a schema's messages, made once for each."""
    descriptors, pools = (import_module(f"google.protobuf.{name}") for name in ("descriptor_pb2", "descriptor_pool"))
    made: dict[str, Any] = {}

    def class_of(schema: Any) -> Any:
        if schema.name not in made:
            pool = pools.DescriptorPool()
            for file in descriptors.FileDescriptorSet.FromString(schema.data).file:
                pool.Add(file)
            made[schema.name] = factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
        return made[schema.name]

    return class_of


def _ld(path: Path) -> tuple[FloatArray, Columns, bool]:
    raw = path.read_bytes()
    channels: dict[str, tuple[int, FloatArray]] = {}
    _, here = _LD_HEADER.unpack_from(raw)
    for _ in range(len(raw) // _LD_CHANNEL.size):  # a chain may bite its tail
        if not here:
            break
        _, following, data_at, count, _, kind, size, rate_hz, shift, factor, scale, decimals, *texts = (
            _LD_CHANNEL.unpack_from(raw, here)
        )
        name, _, unit = (text.partition(b"\0")[0].decode("latin-1").strip() for text in texts)
        values = np.frombuffer(raw, _LD_TYPES[kind, size], count, data_at).astype(np.float64)
        if rate_hz and count:
            physical = (values / (scale or 1) * 10.0**-decimals + shift) * (factor or 1)
            channels[_with_unit(name, "degC" if unit == "C" else unit)] = (rate_hz, physical)
        here = following
    start_s = _ld_start_s(raw)
    is_ours = _OURS.encode() in raw[_LD_COMMENT_AT : _LD_COMMENT_AT + 64]
    if not channels:
        return np.array([]), {}, is_ours
    most_hz, longest = max(channels.values(), key=lambda channel: (channel[0], len(channel[1])))
    time_s = start_s + np.arange(len(longest)) / most_hz
    columns = {}
    for name, (rate_hz, values) in channels.items():
        index = np.arange(len(time_s)) * rate_hz // most_hz
        columns[name] = np.where(index < len(values), values[np.minimum(index, len(values) - 1)], np.nan)
    return time_s, columns, is_ours


def _ld_start_s(raw: bytes) -> float:
    date, clock = (raw[at : at + 16].partition(b"\0")[0].decode("latin-1") for at in (_LD_DATE_AT, _LD_TIME_AT))
    try:
        return datetime.strptime(f"{date} {clock}", "%d/%m/%Y %H:%M:%S").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return 0.0


def _with_unit(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit and unit != "1" else name


def largest_sheet(path: Path) -> tuple[str, bytes]:
    """Return the name of the sheet with the most cells, and its rows as text with tabs between the columns.

    Raises:
        TableUnreadable: the file cannot be read.
        ExtraMissing: python-calamine is not installed.
    """
    try:
        calamine = import_module("python_calamine")
    except ImportError as error:
        raise ExtraMissing("an Excel file", "python-calamine", "excel") from error
    try:
        with path.open("rb") as file:  # by a path it goes by the ending
            book = calamine.CalamineWorkbook.from_filelike(file)
        sheets = {name: book.get_sheet_by_name(name).to_python() for name in book.sheet_names}
    except Exception as error:  # calamine has a class for each part of the format
        raise TableUnreadable(path.name, Message("cannot-be-read", error=str(error))) from error
    name, rows = max(sheets.items(), key=lambda sheet: sum(len(row) for row in sheet[1]), default=("", []))
    return name, "\n".join("\t".join(map(_text, row)) for row in rows).encode()


def _text(value: object) -> str:
    match value:
        case timedelta():
            return repr(value.total_seconds())
        case datetime() | date() | time():
            return value.isoformat()
        case _:
            return str(value).replace("\t", " ").replace("\n", " ")


MOST_BYTES = 512 << 20  # bytes of records, unpacked: half as much memory again


def read_neware(path: Path, kind: str) -> tuple[dict[str, FloatArray], tuple[Message, ...]]:
    """Return the (n,) columns of a file by name, and what its reader remarks.

    The time comes first: ascending over all steps, in seconds since 1970 where the file says when it began; a date
    without a zone counts as UTC.

    Args:
        path: the file.
        kind: "nda" or "ndax".

    Raises:
        TableUnreadable: it cannot be read, is of an unknown version, or holds no record.
        LimitExceeded: it is too large.
        ExtraMissing: fastnda is not installed.
    """
    read = _reader(kind)
    try:
        _check_size(path, kind)
        with warnings.catch_warnings(record=True) as remarks:
            warnings.simplefilter("always")
            frame = read(path)
        columns = _columns(frame)
    except (LimitExceeded, MemoryError):
        raise
    except Exception as error:  # the library lets through whatever its parts raise
        raise TableUnreadable(path.name, Message("no-neware", error=str(error) or type(error).__name__)) from error
    if not len(frame):
        raise TableUnreadable(path.name, Message("no-neware", error="no record"))
    return columns, tuple(Message("neware-remark", text=str(remark.message)) for remark in remarks)


def _reader(kind: str) -> Callable[[Path], Any]:
    unpack = zlib.decompress, zlib.decompressobj
    try:
        module = import_module("fastnda.nda") if kind == "nda" else import_module("fastnda.ndax")
        read: Callable[[Path], Any] = getattr(module, f"read_{kind}")
    except ImportError as error:
        raise ExtraMissing("a Neware file", "fastnda", "neware") from error
    finally:
        zlib.decompress, zlib.decompressobj = unpack  # fastnda puts others in their place, with errors of their own
    return read


def _columns(frame: Any) -> dict[str, FloatArray]:
    columns: dict[str, FloatArray] = {
        name: frame[name].to_numpy().astype(np.float64) for name in frame.columns if frame[name].dtype.is_numeric()
    }
    in_step_s = columns.pop("step_time_s", None)
    time_s = columns.pop("total_time_s", None)
    stamps = columns.pop("unix_time_s", np.array([]))
    if in_step_s is not None:
        time_s = in_step_s + _before(in_step_s, columns.get("step_index", np.zeros(len(in_step_s))))
    if time_s is None:
        return {"time_s": stamps, **columns}
    finite = stamps[np.isfinite(stamps)]
    return {"time_s": time_s + (finite[0] - time_s[0] if len(finite) else 0.0), **columns}


def _before(in_step_s: FloatArray, step: FloatArray) -> FloatArray:
    """How long the test had run when the step of each row began [s]."""
    begins = np.append(False, (np.diff(step) != 0) | (np.diff(in_step_s) < 0))
    lasted = np.where(begins, np.append(0.0, in_step_s[:-1]), 0.0)
    total: FloatArray = np.cumsum(np.nan_to_num(lasted))
    return total


def _check_size(path: Path, kind: str) -> None:
    if kind == "nda":
        size = path.stat().st_size
    else:
        with zipfile.ZipFile(path) as packed:
            size = sum(part.file_size for part in packed.infolist())  # zipfile unpacks no more than this
    if size > MOST_BYTES:
        raise LimitExceeded(Message("limit-neware", limit=Quantity(MOST_BYTES >> 20, "MB")))
