"""The beginning of a recording as it will be understood, before it is imported: columns with samples, first rows."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.sources.recordings.battery_log import BatteryLog, battery_log
from app.sources.recordings.guess import with_units
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.log_signals import column_mapping, read_signals
from app.sources.recordings.quantities import in_our_unit
from app.sources.recordings.table import Table, matching, read_table
from app.words import Message, Text

ROWS = 6
SAMPLES = 3
MOST_FRAMES = 200_000  # frames of a CAN log, which takes a second for each 50,000
Numbers = tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class PreviewColumn:
    """A column of a table, or a signal, with its first values; None where missing."""

    name: str
    samples: Numbers


@dataclass(frozen=True, slots=True)
class CellColumn:
    """A column that fits the pattern of the voltages."""

    name: str
    median_v: float | None


@dataclass(frozen=True, slots=True)
class Understood:
    """The file as the import reads it; the first rows in our units, current positive on discharge."""

    rows: int
    length_s: float
    started_unix_s: float | None
    time_s: Numbers
    current_a: Numbers
    soc: Numbers  # fraction; empty: missing
    voltages_v: tuple[Numbers, ...]  # by row, one a cell
    temperatures_degc: tuple[Numbers, ...]
    notes: tuple[Message, ...]


@dataclass(frozen=True, slots=True)
class Preview:
    """Contents of a file, and how a profile reads it."""

    profile: ImportMapping  # with the units that were picked
    columns: tuple[PreviewColumn, ...]
    cells: tuple[CellColumn, ...]
    understood: Understood | None
    error: Text | None  # why it is not


def preview(path: Path, mapping: ImportMapping, pick: Iterable[str], dbc: Path | None = None) -> Preview:
    """Return what a profile makes of a recording.

    Args:
        path: a table, or with `dbc` a CAN log, of which the first `MOST_FRAMES` frames are looked at.
        mapping: which columns, or signals, are what.
        pick: quantities, of `quantities.UNITS`, whose unit is taken from the names and values instead.
        dbc: what the frames mean.

    Raises:
        ImportFailed, ExtraMissing: the file cannot be read.
    """
    if dbc is None:
        table = read_table(path)
        columns = _columns({name: values[:SAMPLES] for name, values in table.columns.items()})
        return _of_table(table, with_units(mapping, table, pick), columns)
    signals = read_signals(path, dbc, MOST_FRAMES, bus=mapping.bus)
    columns = _columns({name: values[:SAMPLES] for name, (_, values) in sorted(signals.by_name.items())})
    try:
        table = signals.table(mapping)
    except ImportFailed as error:
        return Preview(mapping, columns, (), None, error.reason)
    inside = replace(mapping, **column_mapping(mapping))  # type: ignore[arg-type]
    picked = with_units(inside, table, [quantity for quantity in pick if quantity != "time"])
    own_names = {name: getattr(mapping, name) for name in ("time", "time_unit", "voltages", "temperatures")}
    return replace(_of_table(table, picked, columns), profile=replace(picked, **own_names))


def _columns(samples: Mapping[str, Sequence[float] | FloatArray]) -> tuple[PreviewColumn, ...]:
    return tuple(PreviewColumn(name, _numbers(values)) for name, values in samples.items())


def _of_table(table: Table, mapping: ImportMapping, columns: tuple[PreviewColumn, ...]) -> Preview:
    try:
        understood = _understood(battery_log(table, mapping))
    except ImportFailed as error:
        return Preview(mapping, columns, _cells(table, mapping), None, error.reason)
    return Preview(mapping, columns, _cells(table, mapping), understood, None)


def _cells(table: Table, mapping: ImportMapping) -> tuple[CellColumn, ...]:
    names = [mapping.voltages] if mapping.voltages in table.columns else matching(mapping.voltages, list(table.columns))
    cells = []
    for name in names:
        finite = table.columns[name][np.isfinite(table.columns[name])]
        volts = in_our_unit(finite, "voltage", mapping.voltage_unit) / mapping.cells_in_series
        cells.append(CellColumn(name, float(np.median(volts)) if len(volts) else None))
    return tuple(cells)


def _understood(log: BatteryLog) -> Understood:
    def rows(values: FloatArray) -> tuple[Numbers, ...]:
        return tuple(_numbers(row) for row in values[:ROWS])

    return Understood(
        rows=len(log.time_s),
        length_s=float(log.time_s[-1]),
        started_unix_s=log.started_unix_s,
        time_s=_numbers(log.time_s[:ROWS]),
        current_a=_numbers(log.current_a[:ROWS]),
        soc=() if log.soc is None else _numbers(log.soc[:ROWS]),
        voltages_v=rows(log.voltages_v),
        temperatures_degc=rows(log.temperatures_degc) if np.isfinite(log.temperatures_degc).any() else (),
        notes=log.notes,
    )


def _numbers(values: Sequence[float] | FloatArray) -> Numbers:
    return tuple(float(value) if np.isfinite(value) else None for value in values)
