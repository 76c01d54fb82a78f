"""Neware's binary files, .nda and .ndax, as a table.

fastnda finds the records; it gives the time within each step, of which this makes the time of the test.
"""

import warnings
import zipfile
import zlib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import ExtraMissing, LimitExceeded
from app.estimation.arrays import FloatArray
from app.sources.recordings.csv_table import TableUnreadable
from app.words import Message, Quantity

MOST_BYTES = 512 << 20  # of records, unpacked: half as much memory again


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
    known = stamps[np.isfinite(stamps)]
    return {"time_s": time_s + (known[0] - time_s[0] if len(known) else 0.0), **columns}


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
            size = sum(part.file_size for part in packed.infolist())  # zipfile unpacks no more than is said here
    if size > MOST_BYTES:
        raise LimitExceeded(Message("limit-neware", limit=Quantity(MOST_BYTES >> 20, "MB")))
