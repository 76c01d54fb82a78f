"""Reads tables from CSV, Parquet and other files of test rigs, and finds columns in them by name, number or pattern."""

import gzip
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from app.errors import ImportFailed, LimitExceeded
from app.estimation.arrays import FloatArray
from app.sources.recordings.bad_rows import some_of
from app.sources.recordings.csv_table import MOST_COLUMNS, CsvTable, OnRows, TableUnreadable, read_csv
from app.sources.recordings.kind import CAN_LOGS, is_can_log, kind_of, names_in_zip
from app.sources.recordings.quantities import UNIX_FROM_S, is_wall_clock
from app.sources.recordings.signal_files import largest_sheet, read_neware, read_signals
from app.words import Message, Quantity

UNPACKED_BYTES = 1 << 30  # bytes of a compressed file, unpacked
UNPACKED_RATIO = 200  # beyond 16 MB: numbers as text shrink to a tenth
PARQUET_VALUES = 1 << 27
_ALWAYS_BYTES = 16 << 20
_PIECE_BYTES = 1 << 20
GZIP_MAGIC = b"\x1f\x8b"
PARQUET_MAGIC = b"PAR1"
NO_TABLES = {
    "unknown": Message("no-text"),
    "session": Message("is-session"),
    "mpr": Message("is-mpr"),
    "xls": Message("is-xls"),
    "res": Message("is-res"),
    "candump-no-time": Message("candump-no-time"),
}
OF_SIGNALS = ("mf4", "mcap", "ld")
NEWARE = ("nda", "ndax")
_PLACE = {"n": r"(?P<n>\d{1,9})", "p": r"(?P<p>\d{1,9})"}


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of numbers: (n,) each, NaN where empty."""

    source: str
    columns: Mapping[str, FloatArray]
    has_header: bool = True  # else the names are numbers from 1
    notes: tuple[Message, ...] = ()  # what was done to read it
    header_unix_s: float | None = None  # when it began, by the lines above it

    def started_unix_s(self, row: int) -> float | None:
        """Return when a row was measured by a column of dates and times, else when the table began; None: unknown."""
        for name, values in self.columns.items():
            if is_wall_clock(name) and values[row] > UNIX_FROM_S:
                return float(values[row])
        return self.header_unix_s

    def column(self, what: str, name: str) -> FloatArray:
        """Return one column by its name, or by its number from 1.

        Raises:
            ImportFailed: there is no such column.
        """
        if name in self.columns:
            return self.columns[name]
        if (number := column_number(name, len(self.columns))) is not None:
            return list(self.columns.values())[number - 1]
        raise ImportFailed(
            self.source, Message("no-such-column", what=what, name=repr(name), names=some_of(list(self.columns)))
        )

    def matrix(self, what: str, pattern: str) -> FloatArray:
        """Return the columns of a pattern as (n, k), in the order of pack and number.

        Raises:
            ImportFailed: no column fits the pattern.
        """
        names = matching(pattern, list(self.columns))
        if not names:
            raise ImportFailed(
                self.source,
                Message("no-column-fits", what=what, pattern=repr(pattern), names=some_of(list(self.columns))),
            )
        return np.column_stack([self.columns[name] for name in names])


def column_number(text: str, count: int) -> int | None:
    """Return the number of a column, from 1, that a text is; None where it is none of `count` columns."""
    is_number = text.isascii() and text.isdigit() and len(text) <= len(str(count))
    return int(text) if is_number and 1 <= int(text) <= count else None


def matching(pattern: str, names: Sequence[str]) -> list[str]:
    """Return the names that a pattern with {n}, and {p}, stands for, in the order of pack and number."""
    parts = re.split(r"\{([np])\}", pattern)
    expression = "".join(_PLACE[part] if i % 2 else re.escape(part) for i, part in enumerate(parts))
    try:
        matches = [(match.groupdict(), name) for name in names if (match := re.fullmatch(expression, name))]
    except re.error:
        return []
    matches.sort(key=lambda match: (int(match[0].get("p") or 0), int(match[0].get("n") or 0)))
    return [name for _, name in matches]


def load_table(path: Path, on_read: OnRows = lambda done, of: None) -> Table:
    """Return the table in a CSV or Parquet file, plain or gzip; its kind is taken from its content.

    `on_read` gets how many rows of a text are read, and of how many.

    Raises:
        TableUnreadable: the file cannot be read, or has no table.
        ExtraMissing: a library that it needs is not installed.
    """
    source = path.name
    kind = kind_of(path)
    if kind == "zip":
        raise TableUnreadable(source, Message("is-zip", names=some_of(names_in_zip(path))))
    if kind in NO_TABLES:
        raise TableUnreadable(source, NO_TABLES[kind])
    if kind in OF_SIGNALS and not is_can_log(path):
        return Table(source, read_signals(path, kind))
    if kind in NEWARE:
        of_neware, remarks = read_neware(path, kind)
        return Table(source, of_neware, notes=remarks)
    if kind in CAN_LOGS:
        raise TableUnreadable(source, Message("is-can-log", kind=kind))
    notes: list[Message] = []
    try:
        if kind == "xlsx":
            sheet, raw = largest_sheet(path)
            notes.append(Message("sheet-read", sheet=repr(sheet)))
        else:
            raw = path.read_bytes()
        if raw[:2] == GZIP_MAGIC:
            raw = _unpacked(path, len(raw))
    except (OSError, EOFError, zlib.error) as exc:
        reason = getattr(exc, "strerror", None) or str(exc)  # strerror names no file: the error does
        raise TableUnreadable(str(path), Message("cannot-be-read", error=reason)) from exc
    if raw[:4] == PARQUET_MAGIC:
        table = CsvTable(*_parquet_table(source, raw), None)
    else:
        table = read_csv(source, raw, notes, on_read)
    header, columns, started_unix_s = table
    names = header or [str(i + 1) for i in range(len(columns))]
    names = [f"{name} #{i + 1}" if name in names[:i] else name for i, name in enumerate(names)]
    return Table(source, dict(zip(names, columns, strict=True)), header is not None, tuple(notes), started_unix_s)


def read_table(path: Path, on_read: OnRows = lambda done, of: None) -> Table:
    """Return a CSV or Parquet file's table; `on_read` as for `load_table`.

    Raises:
        ImportFailed: there is no table in it.
    """
    try:
        return load_table(path, on_read)
    except TableUnreadable as error:
        raise ImportFailed(path.name, error.reason) from error


def _unpacked(path: Path, packed: int) -> bytes:
    """What is in a gzip file, as long as it is not out of all proportion."""
    limit = min(UNPACKED_BYTES, max(_ALWAYS_BYTES, UNPACKED_RATIO * packed))
    pieces, size = [], 0
    with gzip.open(path) as file:
        while piece := file.read(_PIECE_BYTES):
            size += len(piece)
            if size > limit:
                raise LimitExceeded(Message("limit-unpacked", limit=Quantity(limit >> 20, "MB")))
            pieces.append(piece)
    return b"".join(pieces)


def _parquet_table(source: str, raw: bytes) -> tuple[list[str], list[FloatArray]]:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as exc:
        raise TableUnreadable(source, Message("parquet-needs-extra")) from exc
    try:
        file = pq.ParquetFile(BytesIO(raw))
        about = file.metadata
        if about.num_columns > MOST_COLUMNS:
            shape = Message("too-many-columns", columns=about.num_columns, most=MOST_COLUMNS)
            raise TableUnreadable(source, shape)
        if about.num_rows * about.num_columns > PARQUET_VALUES:
            shape = Message("limit-rows", rows=about.num_rows, columns=about.num_columns, limit=PARQUET_VALUES)
            raise LimitExceeded(shape)
        table = file.read()
        names = list(table.column_names)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as exc:  # the last: a column's name
        raise TableUnreadable(source, Message("no-parquet", error=str(exc))) from exc
    columns = []
    for column in table.columns:
        is_stamp, is_span = pa.types.is_timestamp(column.type), pa.types.is_duration(column.type)
        if is_stamp or is_span:
            micros = column.cast(pa.timestamp("us") if is_stamp else pa.duration("us"), safe=False)
            columns.append(micros.cast(pa.int64()).cast(pa.float64()).to_numpy() * 1e-6)
            continue
        try:
            columns.append(np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64))
        except pa.ArrowException:
            columns.append(np.full(table.num_rows, np.nan))
    return names, columns
