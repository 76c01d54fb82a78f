"""CSV: one header line, one row an instant, empty where nothing was sampled, the time in ISO 8601 at the end."""

import csv
import math
import re
from collections.abc import Iterable, Iterator
from io import StringIO
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.sessions.export.table import SignalTable
from app.sources.recordings.import_mapping import EXPORT_STAMP, EXPORT_TIMES

_RUNS = ("=", "+", "-", "@", "\t", "\r", "\n")  # what a formula begins with, also behind what is skipped
_NUMBER = re.compile(r"[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?", re.ASCII)


def csv_row(cells: Iterable[object]) -> str:
    """Return a line with its end; None is empty, numbers stay numbers, a text like a formula gets a leading '."""
    line = StringIO()
    csv.writer(line).writerow([_safe(cell) for cell in cells])  # its own line end: a CR in a cell is quoted, too
    return line.getvalue()[:-2] + "\n"


def _safe(cell: object) -> object:
    if cell is None or isinstance(cell, int | float):
        return cell
    text = str(cell)
    return f"'{text}" if text.startswith(_RUNS) and not _NUMBER.fullmatch(text) else text


_CLOSE_TOGETHER = 1 << 20
Bytes = NDArray[np.uint8]  # (rows, bytes), texts filled up with zeros


def csv_parts(table: SignalTable) -> Iterator[bytes]:
    """Yield the file, piece by piece, in UTF-8."""
    names = [*EXPORT_TIMES, *table.columns, EXPORT_STAMP]
    yield csv_row(names).encode()
    groups = [list(group) for _, group in groupby(range(len(table.signals)), lambda i: table.signals[i].scale)]
    for rows in table.rows():
        times = zip(rows.time_s.tolist(), rows.elapsed_s.tolist(), rows.uptime_s.tolist(), strict=True)
        heads = ["{:.3f},{:.3f},{:.3f}".format(*row).replace("nan", "") for row in times]
        parts = [_bytes(np.array(heads, "S")[:, None])]
        for group in groups:
            parts.append(texts_of(rows.values[:, group[0] : group[-1] + 1], table.signals[group[0]].scale))
        stamps = np.datetime_as_string(rows.time_us.astype("datetime64[us]"), unit="us", timezone="UTC")
        parts.append(_bytes(np.array([f",{stamp}\n" for stamp in stamps.tolist()], "S")[:, None]))
        yield np.concatenate(parts, axis=1).tobytes().translate(None, b"\0")


def texts_of(values: FloatArray, scale: float) -> Bytes:
    """The texts of (n, k) counts of one scale, each after a comma; NaN is empty. Each distinct text is made once."""
    decimals = max(0, math.ceil(-math.log10(scale) - 1e-9))  # enough to distinguish one count from the next
    is_known = np.isfinite(values)
    distinct, places = _distinct(np.rint(values[is_known] / scale).astype(np.int64))
    texts = np.array([",", *[f",%.{decimals}f" % value for value in (distinct * scale).tolist()]], "S")
    text_of = np.zeros(values.shape, np.intp)
    text_of[is_known] = places + 1
    return _bytes(texts[text_of])


def _distinct(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
    """Return the distinct counts, ascending, and the place of each count among them."""
    if not len(counts) or np.ptp(counts) > _CLOSE_TOGETHER:
        return np.unique(counts, return_inverse=True)
    low = counts.min()
    is_there = np.zeros(np.ptp(counts) + 1, bool)
    is_there[counts - low] = True
    return np.flatnonzero(is_there) + low, np.cumsum(is_there)[counts - low] - 1


def _bytes(texts: NDArray[np.bytes_]) -> Bytes:
    return texts.view(np.uint8).reshape(len(texts), -1)
