"""Reads recordings of cells from CSV and Parquet files, plain or gzip, with columns as users name them.

Which column means what is settled here; what the numbers mean and how they are repaired is `estimation.importer`.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.estimation.errors import DatasetError
from app.estimation.recording.cell_recording import FIELDS, FloatArray, Recording, clean
from app.sources.recordings.column_names import field_of, is_wall_clock
from app.sources.recordings.csv_table import read_csv

UNUSED_NAMED = 6  # columns without a use that a note names
GZIP_MAGIC = b"\x1f\x8b"
PARQUET_MAGIC = b"PAR1"


class Source(NamedTuple):
    """Where a field comes from: the column's name or its number from 1, and a factor into our unit."""

    column: str
    factor: float


def parse_map(entries: Sequence[str]) -> dict[str, Source]:
    """Return the sources of the fields out of texts like `current_a=I_batt` or `current_a=2*0.001`.

    Raises:
        DatasetError: an entry is not FIELD=COLUMN or FIELD=COLUMN*FACTOR with a known field.
    """
    sources: dict[str, Source] = {}
    for entry in (part for text in entries for part in text.split(",") if part.strip()):
        field, sign, column = entry.partition("=")
        field = field.strip()
        field = {"temperature_c": "temperature_degc"}.get(field, field)
        if not sign or field not in FIELDS or not column.strip():
            raise DatasetError("--map", f"{entry!r} is not FIELD=COLUMN[*FACTOR] with FIELD one of {', '.join(FIELDS)}")
        name, star, factor = column.rpartition("*")
        try:
            sources[field] = Source(name.strip(), float(factor)) if star else Source(column.strip(), 1.0)
        except ValueError:
            raise DatasetError("--map", f"{entry!r}: {factor!r} is not a factor") from None
    return sources


def load_recording(
    path: Path,
    mapping: Mapping[str, Source] | None = None,
    *,
    charge_positive: bool = False,
    period_s: float | None = None,
) -> Recording:
    """Return the recording in a CSV or Parquet file, plain or gzip.

    Args:
        path: the file; its kind is taken from its content.
        mapping: source of each field; fields left out are found by the usual names and units in the header. Without a
            header the columns are taken in the order of `FIELDS`.
        charge_positive: the file counts charging current as positive.
        period_s: time between rows [s] where the file has no time column.

    Raises:
        DatasetError: the file cannot be read, has no table, or its columns cannot be used.
    """
    source = path.name
    header, columns, notes = load_table(path)
    fields = _assign(source, header, columns, mapping or {}, notes)
    recording = clean(source, fields, charge_positive=charge_positive, period_s=period_s)
    return Recording(**{**vars(recording), "notes": (*notes, *recording.notes)})


def load_table(path: Path) -> tuple[list[str] | None, list[FloatArray], list[str]]:
    """Return (names, columns, what was done to read it) of a CSV or Parquet file; None without a header.

    Raises:
        DatasetError: the file cannot be read, or has no table.
    """
    source = path.name
    try:
        raw = path.read_bytes()
        if raw[:2] == GZIP_MAGIC:
            raw = gzip.decompress(raw)
    except (OSError, EOFError, zlib.error) as exc:
        raise DatasetError(str(path), f"cannot be read: {exc}") from exc
    notes: list[str] = []
    if raw[:4] == PARQUET_MAGIC:
        return *_parquet_table(source, raw), notes
    header, columns = read_csv(source, raw, notes)
    return header, columns, notes


def _parquet_table(source: str, raw: bytes) -> tuple[list[str], list[FloatArray]]:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as exc:
        raise DatasetError(source, "reading Parquet needs the extra: pip install voltwall[parquet]") from exc
    try:
        table = pq.read_table(BytesIO(raw))
    except (pa.ArrowException, OSError) as exc:
        raise DatasetError(source, f"not a readable Parquet file: {exc}") from exc
    columns = []
    for column in table.columns:
        is_stamp, is_span = pa.types.is_timestamp(column.type), pa.types.is_duration(column.type)
        if is_stamp or is_span:
            micros = column.cast(pa.timestamp("us") if is_stamp else pa.duration("us"), safe=False)
            columns.append(micros.cast(pa.int64()).cast(pa.float64()).to_numpy() * 1e-6)
            continue
        try:
            columns.append(np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64))
        except pa.ArrowException:
            columns.append(np.full(table.num_rows, np.nan))
    return list(table.column_names), columns


def _assign(
    source: str,
    header: list[str] | None,
    columns: list[FloatArray],
    mapping: Mapping[str, Source],
    notes: list[str],
) -> dict[str, FloatArray]:
    """Return the columns by field: mapped ones first, then those the header names, else the usual order."""
    fields = {
        field: columns[_mapped_index(source, field, wanted, header, len(columns))] * wanted.factor
        for field, wanted in mapping.items()
    }
    if header is None:
        if mapping:
            return fields
        if not 3 <= len(columns) <= len(FIELDS):
            raise DatasetError(
                source, f"no header over {len(columns)} columns; say which is which with --map time_s=1,..."
            )
        notes.append(f"no header: columns taken as {', '.join(FIELDS[: len(columns)])}")
        return dict(zip(FIELDS, columns, strict=False))
    taken = {wanted.column for wanted in mapping.values()}
    unused = []
    for name, values in zip(header, columns, strict=True):
        found = field_of(name)
        if found is None:
            unused += [name] if name and name not in taken else []
        elif found[0] in fields:
            if found[0] not in mapping:
                notes.append(f"{found[0]} is in more than one column: {name!r} not used")
        else:
            fields[found[0]] = values * found[1]
            if found[1] != 1.0:
                notes.append(f"column {name!r} multiplied by {found[1]:g} into {found[0]}")
    if "time_s" not in fields:
        wall = [(name, values) for name, values in zip(header, columns, strict=True) if is_wall_clock(name)]
        if wall:
            fields["time_s"] = wall[0][1]
            unused.remove(wall[0][0])
    if unused:
        more = f" and {len(unused) - UNUSED_NAMED} more" if len(unused) > UNUSED_NAMED else ""
        notes.append(f"columns not used: {', '.join(unused[:UNUSED_NAMED])}{more}")
    return fields


def _mapped_index(source: str, field: str, wanted: Source, header: list[str] | None, width: int) -> int:
    if header is not None and wanted.column in header:
        return header.index(wanted.column)
    if wanted.column.isdigit() and 1 <= int(wanted.column) <= width:
        return int(wanted.column) - 1
    have = f"the header has {', '.join(header)}" if header else f"there is no header; number them 1 to {width}"
    raise DatasetError(source, f"--map {field}={wanted.column}: no such column; {have}")
