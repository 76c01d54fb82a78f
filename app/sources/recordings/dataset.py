"""Reads recordings of one cell from tables, with columns as users name them.

Which column means what is settled here; what the numbers mean and how they are repaired is `estimation.recording`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.estimation.errors import DatasetError
from app.estimation.recording.cell_recording import FIELDS, Recording, clean
from app.sources.recordings.clock import rows_in_time
from app.sources.recordings.impossible import measured_currents, measured_temperatures
from app.sources.recordings.quantities import (
    UNITS,
    Candidate,
    candidates,
    charges_positive,
    in_our_unit,
    is_wall_clock,
    signed,
    time_unit_of,
)
from app.sources.recordings.table import Table, column_number, load_table
from app.words import Message, render

FIELD_OF = dict(zip(UNITS, FIELDS, strict=True))  # field of each quantity
UNUSED_NAMED = 6  # columns without a use that a note names


class Source(NamedTuple):
    """The column of a field: its name or its number from 1, and a factor into our unit."""

    column: str
    factor: float


MAP_FIELDS = ("time_s", "current_a", "voltage_v", "temperature_c", "soc")  # as the help names them


def map_of(entries: Sequence[str], path: Path) -> list[str]:
    """Return the entries that hold for a file: those without a file's name before a colon, and those with its own.

    What names the file takes the place of what holds for all.
    """
    common, own = [], []
    for entry in entries:
        name, colon, rest = entry.partition(":")
        is_named = bool(colon) and "=" not in name
        if not is_named:
            common.append(entry)
        elif name in (path.name, str(path)):
            own.append(rest)
    return own or common


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
            raise DatasetError(
                "--map", f"{entry!r} is not FIELD=COLUMN[*FACTOR] with FIELD one of {', '.join(MAP_FIELDS)}"
            )
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
        charge_positive: the file counts charging current as positive; it is also found by what the voltage does.
        period_s: time between rows [s] where the file has no time column.

    Raises:
        DatasetError: the file cannot be read, has no table, or its columns cannot be used.
    """
    table = load_table(path)
    notes = list(table.notes)
    fields = _assign(table, mapping or {}, notes)
    if "temperature_degc" in fields:
        fields["temperature_degc"] = measured_temperatures(fields["temperature_degc"][:, None], notes)[:, 0]
    if "current_a" in fields:
        fields["current_a"] = measured_currents(fields["current_a"], notes)
        fields["current_a"], direction = signed(fields["current_a"], table.columns)
        charge_positive &= direction is None
        if direction is not None:
            notes.append(Message("no-sign", direction=direction))
        elif not charge_positive and "voltage_v" in fields:
            charge_positive = charges_positive(fields["current_a"], fields["voltage_v"])
            if charge_positive:
                notes.append(Message("voltage-rises"))
    try:
        fields = _in_order_of_time(table.source, fields, notes)
    except ImportFailed as error:
        raise DatasetError(table.source, render(error.reason)) from error
    recording = clean(table.source, fields, charge_positive=charge_positive, period_s=period_s)
    return replace(recording, notes=(*map(render, notes), *recording.notes))


def _in_order_of_time(source: str, fields: Mapping[str, FloatArray], notes: list[Message]) -> dict[str, FloatArray]:
    """Return the fields' rows in the order of time.

    Raises:
        ImportFailed: the column of times holds none.
    """
    if "time_s" not in fields:
        return dict(fields)
    rows = rows_in_time(source, fields["time_s"], notes)
    return {field: values[rows.order] for field, values in fields.items()} | {"time_s": rows.time_s}


def _assign(table: Table, mapping: Mapping[str, Source], notes: list[Message]) -> dict[str, FloatArray]:
    """Return the columns by field: mapped ones first, then those the header names, else the usual order."""
    columns = table.columns
    fields = {field: _mapped(table, field, wanted) * wanted.factor for field, wanted in mapping.items()}
    if not table.has_header:
        if mapping:
            return fields
        if not 3 <= len(columns) <= len(FIELDS):
            raise DatasetError(
                table.source, f"no header over {len(columns)} columns; say which is which with --map time_s=1,..."
            )
        notes.append(Message("no-header", fields=FIELDS[: len(columns)]))
        return dict(zip(FIELDS, columns.values(), strict=False))
    taken = {wanted.column for wanted in mapping.values()}
    for quantity, field in FIELD_OF.items():
        if field in fields:
            continue
        options = candidates(quantity, {name: values for name, values in columns.items() if name not in taken})
        if not options or (not options[0].is_plain and len(options) > 1 and options[1].score == options[0].score):
            continue  # nothing, or two names that sound alike
        best, *others = options
        if not best.is_plain and not is_wall_clock(best.name):
            notes.append(Message("taken-from", field=field, column=repr(best.name)))
        alike = [other.name for other in others if other.is_plain and other.score == best.score]
        notes += [Message("in-more-columns", field=field, column=repr(name)) for name in alike]
        fields[field] = _converted(table, best, quantity, notes)
        taken |= {best.name, *alike}
    unused = [name for name in columns if name and name not in taken]
    if unused:
        named = tuple(unused[:UNUSED_NAMED])
        more = len(unused) - len(named)
        notes.append(
            Message("some-unused", columns=named, more=more) if more else Message("columns-unused", columns=named)
        )
    return fields


def _converted(table: Table, candidate: Candidate, quantity: str, notes: list[Message]) -> FloatArray:
    unit = candidate.unit
    if quantity == "time" and (unit := time_unit_of(candidate.name, table.columns)) is None:
        raise DatasetError(
            table.source,
            f"{candidate.name!r} has no unit; give it with --map time_s={candidate.name}*0.001 (ms) or *1 (s)",
        )
    if unit is None:
        return table.columns[candidate.name]
    if UNITS[quantity][unit] != (1, 0):
        notes.append(Message("converted", column=repr(candidate.name), unit=unit))
    return in_our_unit(table.columns[candidate.name], quantity, unit)


def _mapped(table: Table, field: str, wanted: Source) -> FloatArray:
    names = list(table.columns)
    if wanted.column in names:
        return table.columns[wanted.column]
    if (number := column_number(wanted.column, len(names))) is not None:
        return table.columns[names[number - 1]]
    have = f"the header has {', '.join(names)}" if table.has_header else f"no header; number them 1 to {len(names)}"
    raise DatasetError(table.source, f"--map {field}={wanted.column}: no such column; {have}")
