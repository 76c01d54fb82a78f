"""A first import mapping of a table, by its names and numbers: a profile to begin with."""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from app.estimation.arrays import FloatArray, median
from app.sources.recordings.import_mapping import EXPORT_STAMP, EXPORT_TIMES, ImportMapping
from app.sources.recordings.impossible import measured_currents
from app.sources.recordings.quantities import UNITS, candidates, charges_positive, sounds_like, time_unit_of, unit_of
from app.sources.recordings.table import Table, column_number, matching

SOC_IN_PERCENT, KELVIN_FROM, MILLIVOLTS_FROM = 1.5, 200.0, 500.0  # medians beyond them
ONE_CELL_BELOW_V, USUAL_CELL_V = 10.0, 3.7  # a higher voltage is that of so many cells in series
MILLIAMPS_FROM = 5000.0  # no battery that we know has so many amperes
FIELD_OF_QUANTITY = {
    "time": "time",
    "current": "current",
    "voltage": "voltages",
    "temperature": "temperatures",
    "soc": "soc",
}


def guess(table: Table) -> ImportMapping:
    """Return the profile that the names and numbers suggest; what is not clear is left empty."""
    names = list(table.columns)
    if tuple(names[: len(EXPORT_TIMES)]) == EXPORT_TIMES:
        return _of_export(names)
    groups: dict[str, list[str]] = defaultdict(list)
    for name in names:
        if re.search(r"\d", name):
            groups[re.sub(r"\d+", "#", name)].append(name)
    mapping = ImportMapping()
    many = sorted((group for group in groups.values() if len(group) > 1), key=lambda group: -len(group))
    for members in many:
        pattern = _pattern(members)
        if not pattern:
            continue
        values = np.concatenate([table.columns[name] for name in members])
        middle = median(values[values != 0.0])
        size = median(np.abs(values[values != 0.0]))  # a sign may mark a cell
        if not mapping.temperatures and sounds_like(members[0], "temperature") and -60 < middle < 400:
            mapping = replace(mapping, temperatures=pattern)
        elif not mapping.voltages and sounds_like(members[0], "voltage") and _voltage_unit(size):
            mapping = replace(mapping, voltages=pattern)
    grouped = {name for pattern in (mapping.voltages, mapping.temperatures) for name in matching(pattern, names)}
    columns = {name: values for name, values in table.columns.items() if name not in grouped}
    best: dict[str, str] = {}
    for quantity in UNITS:
        options = candidates(quantity, columns)
        is_clear = (
            quantity != "voltage" or not options[1:] or options[0].is_plain or options[1].score < options[0].score
        )
        best[quantity] = options[0].name if options and is_clear else ""
        columns.pop(best[quantity], None)
    mapping = replace(mapping, time=best["time"], current=best["current"], soc=best["soc"])
    if not mapping.voltages and best["voltage"]:
        mapping = replace(mapping, voltages=best["voltage"], temperatures=mapping.temperatures or best["temperature"])
    mapping = with_units(mapping, table, UNITS)
    if mapping.voltages == best["voltage"] != "":
        volts = median(table.columns[mapping.voltages]) * UNITS["voltage"][mapping.voltage_unit][0]
        in_series = 1.0 if volts < ONE_CELL_BELOW_V else float(max(1, round(volts / USUAL_CELL_V)))
        mapping = replace(mapping, cells_in_series=in_series)
    return replace(mapping, charge_positive=_charges_positive(table, mapping))


def with_units(mapping: ImportMapping, table: Table, quantities: Iterable[str]) -> ImportMapping:
    """Return the profile with the units of some quantities as the names of their columns, or else the values, tell."""
    for quantity in quantities:
        names = _named(mapping, quantity, table)
        if names and quantity == "time":
            mapping = replace(mapping, time_unit=time_unit_of(names[0], table.columns) or "")
        elif names:
            values = np.concatenate([table.columns[name] for name in names])
            mapping = replace(mapping, **{f"{quantity}_unit": _unit(quantity, names, values)})  # type: ignore[arg-type]
    return mapping


def _named(mapping: ImportMapping, quantity: str, table: Table) -> list[str]:
    """The columns that a profile names for a quantity."""
    name: str = getattr(mapping, FIELD_OF_QUANTITY[quantity])
    names = list(table.columns)
    if name in names:
        return [name]
    if (number := column_number(name, len(names))) is not None:
        return [names[number - 1]]
    return matching(name, names) if quantity in ("voltage", "temperature") else []


def _unit(quantity: str, names: Sequence[str], values: FloatArray) -> str:
    named = unit_of(names[0], quantity)
    middle = median(values[values != 0.0] if len(names) > 1 else values)
    match quantity:
        case "voltage":
            middle = median(np.abs(values[values != 0.0])) if len(names) > 1 else middle
            alone = named or ("mV" if middle > MILLIVOLTS_FROM else "V")
            return (_voltage_unit(middle) or alone) if len(names) > 1 else alone
        case "temperature":
            return named or ("K" if middle > KELVIN_FROM else "degC")
        case "soc":
            return named or ("percent" if middle > SOC_IN_PERCENT else "fraction")
        case _:
            return named or ("mA" if np.any(np.abs(measured_currents(values, [])) > MILLIAMPS_FROM) else "A")


def _charges_positive(table: Table, mapping: ImportMapping) -> bool:
    if not mapping.current or not mapping.voltages:
        return False
    voltages = table.matrix("voltages", mapping.voltages)
    current = measured_currents(table.column("current", mapping.current), [])
    return charges_positive(current, np.abs(voltages).sum(axis=1))


def _of_export(names: list[str]) -> ImportMapping:
    """The profile of a table that `voltwall export` wrote."""

    def first(*wanted: str) -> str:
        return next((name for name in wanted if matching(name, names)), "")

    return ImportMapping(
        time=first(EXPORT_STAMP, EXPORT_TIMES[0]),
        current=first("i_fs (A)", "i_fc (A)", "i_fs", "i_fc"),
        voltages=first("v[{n}] (V)", "v_{n}", "pack{p}_cell{n}_v", "v_{n} (V)", "pack{p}_cell{n}_v (V)"),
        temperatures=first("t[{n}] (degC)", "t_{n}", "pack{p}_cell{n}_t", "t_{n} (degC)", "pack{p}_cell{n}_t (degC)"),
        soc=first("soc"),
        soc_unit="fraction",
    )


def _pattern(names: list[str]) -> str:
    """The pattern of names that differ in their numbers only; "" where more than two of the numbers differ."""
    parts = [re.split(r"(\d+)", name) for name in names]
    places = list(range(1, len(parts[0]), 2))
    if len(places) > 2:  # `Cell 7 (0.1mV)`: what is the same in all of them stands as it is
        places = [i for i in places if len({part[i] for part in parts}) > 1]
    if len(places) > 2:
        return ""
    marks = dict(zip(places, ("{p}", "{n}")[-len(places) :], strict=True))
    return "".join(marks.get(i, part) for i, part in enumerate(parts[0]))


def _voltage_unit(middle: float) -> str:
    for unit, low in (("V", 1.5), ("mV", 1500.0), ("0.1mV", 15000.0)):
        if low < middle < low * 10 / 3:
            return unit
    return ""
