"""Reads recordings of cells from CSV and Parquet files, plain or gzip, with columns as users name them.

Which column means what is settled here; what the numbers mean and how they are repaired is `estimation.importer`.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Mapping, Sequence
from datetime import datetime
from io import BytesIO, StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.estimation.importer import FIELDS, DatasetError, FloatArray, Recording, clean

NAMES = {
    "time_s": ("time", "testtime", "t", "elapsed", "elapsedtime", "timestamp", "seconds", "totaltime", "zeit", "tid"),
    "current_a": ("current", "i", "cellcurrent", "ibatt", "amps", "batterycurrent", "strom", "strøm"),
    "voltage_v": (
        "voltage",
        "v",
        "u",
        "cellvoltage",
        "terminalvoltage",
        "vbatt",
        "volts",
        "ewe",
        "batteryvoltage",
        "spannung",
        "spenning",
    ),
    "temperature_degc": (
        "temperature",
        "temp",
        "celltemperature",
        "celltemp",
        "tcell",
        "batterytemperature",
        "temperatur",
    ),
    "soc": ("soc", "stateofcharge"),
}
UNITS = {
    "time_s": {
        "s": 1.0,
        "sec": 1.0,
        "seconds": 1.0,
        "ms": 1e-3,
        "min": 60.0,
        "h": 3600.0,
        "hr": 3600.0,
        "hours": 3600.0,
    },
    "current_a": {"a": 1.0, "ma": 1e-3, "amps": 1.0},
    "voltage_v": {"v": 1.0, "mv": 1e-3, "volts": 1.0},
    "temperature_degc": {"c": 1.0, "degc": 1.0, "°c": 1.0, "oc": 1.0, "k": 1.0},
    "soc": {"1": 1.0, "frac": 1.0, "%": 0.01, "percent": 0.01, "pct": 0.01},
}
MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "--"})
DELIMITERS = (";", "\t", ",")
CLOCK = re.compile(r"(?:(\d+)d ?)?(\d{1,4}):([0-5]?\d)(?::([0-5]?\d(?:\.\d+)?))?")
DATE = re.compile(r"(\d{1,2})([./])(\d{1,2})\2(\d{4})(?=[ T])")
PREAMBLE_LIMIT = 100  # lines of remarks a rig may write before its table
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
    header, columns = _csv_table(source, raw, notes)
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
        if pa.types.is_timestamp(column.type):
            column = pa.compute.cast(column, pa.timestamp("us")).cast(pa.int64()).cast(pa.float64())
            columns.append(column.to_numpy() * 1e-6)
            continue
        try:
            columns.append(np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64))
        except pa.ArrowException:
            columns.append(np.full(table.num_rows, np.nan))
    return list(table.column_names), columns


def _csv_table(source: str, raw: bytes, notes: list[str]) -> tuple[list[str] | None, list[FloatArray]]:
    try:
        text = raw.decode("utf-16" if raw[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        raise DatasetError(source, "the file is empty")
    if not any(delimiter in line for line in lines[:PREAMBLE_LIMIT] for delimiter in DELIMITERS):
        lines = ["\t".join(line.split()) for line in lines]
    delimiter, start = _find_table(source, lines)
    if _ends_every_row(lines, start, delimiter):
        lines = [line.removesuffix(delimiter) for line in lines]
    header, header_lines = _header_above(lines, start, delimiter)
    body = lines[start:]
    width = len(body[0].split(delimiter))
    if delimiter == ";" and any("," in line for line in body[:20]):
        body = [line.replace(",", ".") for line in body]
        notes.append("decimal commas read as points")
    skipped = start - header_lines
    if skipped:
        notes.append(f"{skipped} lines above the table left out")
    return header, _numbers(source, body, delimiter, width, notes)


def _find_table(source: str, lines: list[str]) -> tuple[str, int]:
    """Return the delimiter and the index of the first line that is a row of numbers."""
    for k, line in enumerate(lines[:PREAMBLE_LIMIT]):
        for delimiter in DELIMITERS:
            tokens = line.replace(",", ".").split(";") if delimiter == ";" else line.split(delimiter)
            values = [_number(token) for token in tokens]
            if len(tokens) >= 2 and None not in values and any(value == value for value in values):
                return delimiter, _with_broken_rows(lines, k, delimiter)
    last = min(len(lines), PREAMBLE_LIMIT)
    raise DatasetError(source, f"no row of numbers in the first {last} lines; line {last} is {lines[last - 1][:60]!r}")


def _ends_every_row(lines: list[str], start: int, delimiter: str) -> bool:
    """Return whether the delimiter stands after the last column too, and not before one that is empty."""
    above = lines[start - 1] if start else ""
    width = lines[start].count(delimiter)
    is_named = above.count(delimiter) == width and not above.endswith(delimiter)
    return not is_named and all(line.endswith(delimiter) for line in lines[start:])


def _with_broken_rows(lines: list[str], start: int, delimiter: str) -> int:
    """Return where the table begins: rows above `start` of which only some fields are numbers belong to it."""
    width = len(lines[start].split(delimiter))
    while start > 0:
        tokens = lines[start - 1].split(delimiter)
        values = [_number(token) for token in tokens]
        if len(tokens) != width or not any(value is not None and value == value for value in values):
            break
        start -= 1
    return start


def _number(token: str) -> float | None:
    """Return the number a token holds, NaN for a missing one, a time stamp in seconds, None for a word."""
    token = token.strip().strip('"')
    if token.lower() in MISSING:
        return float("nan")
    try:
        return float(token)
    except ValueError:
        pass
    return _stamp_s(token) if token[:1].isdigit() else None


def _stamp_s(token: str) -> float | None:
    """Return a date with its time, or hours, minutes and seconds, in seconds; None for something else.

    2026-05-01T12:00:00, 2026/05/01 12:00:00, 01.05.2026 12:00:00 (day first), 05/01/2026 12:00:00 (month first, as
    long as it can be one), 12:00:00.5, 2d 12:00:00.
    """
    clock = CLOCK.fullmatch(token)
    if clock is not None:
        days, hours, minutes, seconds = clock.groups()
        return 86400.0 * float(days or 0) + 3600.0 * float(hours) + 60.0 * float(minutes) + float(seconds or 0)
    date = DATE.match(token)
    if date is not None:
        first, separator, second, year = date.groups()
        day, month = (second, first) if separator == "/" and int(first) <= 12 else (first, second)
        token = f"{year}-{int(month):02d}-{int(day):02d}{token[date.end() :]}"
    try:
        return datetime.fromisoformat(token.replace("/", "-", 2)).timestamp()
    except ValueError:
        return None


def _header_above(lines: list[str], start: int, delimiter: str) -> tuple[list[str] | None, int]:
    """Return the names above the first row of numbers, None where there are none, and the lines they take up."""
    width = len(lines[start].split(delimiter))
    above = [[token.strip().strip('"') for token in line.split(delimiter)] for line in lines[max(start - 2, 0) : start]]
    above = [tokens for tokens in above if len(tokens) == width]
    if not above:
        return None, 0
    known_units = {unit for units in UNITS.values() for unit in units}
    if len(above) == 2 and all(token.strip("[]() ").lower() in known_units | {""} for token in above[1]):
        return [f"{name} [{unit.strip('[]() ')}]" if unit else name for name, unit in zip(*above, strict=True)], 2
    return above[-1], 1


def _numbers(source: str, body: list[str], delimiter: str, width: int, notes: list[str]) -> list[FloatArray]:
    text = "\n".join(body)
    empty = delimiter * 2
    while empty in text:
        text = text.replace(empty, f"{delimiter}nan{delimiter}")
    text = text.replace(f"{delimiter}\n", f"{delimiter}nan\n").replace(f"\n{delimiter}", f"\nnan{delimiter}")
    text = f"nan{text}" if text.startswith(delimiter) else text
    text = f"{text}nan" if text.endswith(delimiter) else text
    try:
        table = np.loadtxt(StringIO(text), delimiter=delimiter, ndmin=2, comments=None)
    except ValueError:
        return _numbers_row_by_row(source, body, delimiter, width, notes)
    return list(table.T)


def _numbers_row_by_row(source: str, body: list[str], delimiter: str, width: int, notes: list[str]) -> list[FloatArray]:
    rows, broken = [], 0
    for line in body:
        values = [_number(token) for token in line.split(delimiter)]
        if len(values) != width:
            broken += 1
            continue
        broken += None in values
        rows.append([float("nan") if value is None else value for value in values])
    if broken > 0.5 * len(body):
        raise DatasetError(source, f"{broken} of {len(body)} rows are not {width} numbers apart by {delimiter!r}")
    if broken:
        notes.append(f"{broken} rows are not {width} numbers: read as missing or left out")
    return list(np.array(rows, dtype=np.float64).T)


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
        found = _field_of(name)
        if found is None:
            unused += [name] if name and name not in taken else []
        elif found[0] in fields:
            if found[0] not in mapping:
                notes.append(f"{found[0]} is in more than one column: {name!r} not used")
        else:
            fields[found[0]] = values * found[1]
            if found[1] != 1.0:
                notes.append(f"column {name!r} multiplied by {found[1]:g} into {found[0]}")
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


def _field_of(name: str) -> tuple[str, float] | None:
    """Return the field a header text names and the factor of its unit, None for a column that is not ours."""
    if name.strip() == "T":
        return "temperature_degc", 1.0
    words = [word for word in re.split(r"[\s_/()\[\]{}]+", name.strip().lower()) if word]
    for field, known in NAMES.items():
        for cut in (len(words), len(words) - 1):
            if cut < 1 or "".join(words[:cut]) not in known:
                continue
            unit = words[cut] if cut < len(words) else None
            if unit is None:
                return field, 1.0
            if unit in UNITS[field]:
                return field, UNITS[field][unit]
    return None
