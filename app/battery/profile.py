"""A battery's profile: TOML text to the battery and its source. Errors name line and field."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from app.battery.battery import LIMITS, Battery, Drawing, each_cell, spread, spread_in_packs
from app.battery.fields import MANY, MOST_CELLS, TABLES
from app.battery.serial import SerialMapping
from app.battery.serial_profile import SerialTables
from app.battery.source import (
    KINDS,
    READINGS,
    STATES,
    CellSignals,
    DbcMapping,
    MemoryMap,
    ScalarSignal,
    Source,
    StateSignal,
    TableMapping,
)
from app.battery.table_reader import ProfileError, TableReader
from app.battery.toml_lines import line_of, lines_of_keys
from app.estimation.cell_model.default_cell import DEFAULT_CELL
from app.estimation.toml_text import TomlError, read_toml
from app.words import Message

Include = Callable[[str], "Document"]
FORMER_PACKS = "segments"
WITHDRAWN = "witness"  # table of another source of the same battery


@dataclass(frozen=True, slots=True)
class Document:
    """A profile's tables before they are understood, with what it includes merged in."""

    file: str
    values: Mapping[str, Any]
    lines: Mapping[str, int]  # line numbers in the profile itself


@dataclass(frozen=True, slots=True)
class BatteryProfile:
    """A battery and its source."""

    file: str
    battery: Battery
    source: Source


def read_document(text: str, file: str, include: Include) -> Document:
    """Return a profile's tables; `include` returns those of another one by its name.

    Raises:
        ProfileError: the text is no TOML, or what it includes is missing or wrong.
    """
    try:
        values = read_toml(text)
    except TomlError as error:
        raise ProfileError(file, error.line, "TOML", "", str(error)) from error
    values, lines = _with_packs(values, lines_of_keys(text))
    reader = TableReader(file, "", values, TABLES[""], lines)
    for name in reader.texts("include"):
        values = _merged(include(name).values, values)
    return Document(file, values, lines)


def _with_packs(values: dict[str, Any], lines: dict[str, int]) -> tuple[dict[str, Any], dict[str, int]]:
    """Return a profile whose `[battery]` names its packs by the former key `segments` as one that names `packs`."""
    battery = values.get("battery")
    if not isinstance(battery, dict) or FORMER_PACKS not in battery or "packs" in battery:
        return values, lines
    named = {"packs" if name == FORMER_PACKS else name: value for name, value in battery.items()}
    former = f"battery.{FORMER_PACKS}"
    return values | {"battery": named}, lines | ({"battery.packs": lines[former]} if former in lines else {})


def _merged(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Tables are joined, DBC files are added up, anything else of `over` replaces what is under it."""
    joined = dict(under)
    for name, value in over.items():
        if isinstance(value, dict) and isinstance(under.get(name), dict):
            joined[name] = _merged(under[name], value)
        elif name == "dbc" and name in under:
            joined[name] = [*_list(value), *(text for text in _list(under[name]) if text not in _list(value))]
        else:
            joined[name] = value
    return joined


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def understand(document: Document) -> BatteryProfile:
    """Return the battery and source of a profile's tables.

    Raises:
        ProfileError: a field is missing, unknown, of the wrong kind or beyond its bounds.
    """
    refuse_withdrawn(document)
    _table(document, "").check_names(("battery", "source", "serial"))
    _table(document, "battery").check_names(("drawing", "temperatures", "limits", "rules"))
    battery = _battery(document)
    return BatteryProfile(document.file, battery, _serial(document, battery) or _source(document))


def refuse_withdrawn(document: Document) -> None:
    """Refuse a profile with a table of an earlier version that would now be left out without a word.

    Raises:
        ProfileError: it has a `[[witness]]`.
    """
    if WITHDRAWN in document.values:
        line = line_of(document.lines, f"{WITHDRAWN}[0]")
        raise ProfileError(document.file, line, WITHDRAWN, "[[witness]]", Message("witness-withdrawn"))


def _table(document: Document, path: str, index: int | None = None) -> TableReader:
    values: Any = document.values
    for name in path.split(".") if path else ():
        values = values.get(name, {}) if isinstance(values, Mapping) else {}
    if index is not None:
        values = values[index]
    here = path if index is None else f"{path}[{index}]"
    reader = TableReader(
        document.file, here, values if isinstance(values, Mapping) else {}, TABLES[path], document.lines
    )
    if not isinstance(values, Mapping):
        raise ProfileError(document.file, reader.line, here, str(values)[:60], Message("kind-table"))
    return reader


def _battery(document: Document) -> Battery:
    table = _table(document, "battery")
    segments = table.counts("packs") or ()
    if not segments or sum(segments) > MOST_CELLS:
        raise table.error("packs", list(segments), Message("kind-counts", bounds=f"1..{MOST_CELLS}"))
    limits, rules = _table(document, "battery.limits"), _table(document, "battery.rules")
    for part in (limits, rules):
        part.check_names()
    return Battery(
        name=table.text("name"),
        segments=segments,
        parallel=table.count("parallel", 1),
        cell=table.text("cell", DEFAULT_CELL),
        bleed_ohm=table.optional_number("bleed_ohm"),
        drawing=_drawing(_table(document, "battery.drawing"), len(segments)),
        sensors=_sensors(_table(document, "battery.temperatures"), segments),
        limits={name: limit for name in LIMITS if (limit := limits.limit(name)) is not None},
        rules={name: rule for name in LIMITS if (rule := rules.optional_number(name)) is not None},
    )


def _drawing(table: TableReader, n_packs: int) -> Drawing:
    table.check_names()
    order, turned = table.counts("order") or (), table.counts("turned") or ()
    if order and sorted(order) != list(range(1, n_packs + 1)):
        raise table.error("order", list(order), Message("each-pack-once", n=n_packs))
    if turned and max(turned) > n_packs:
        raise table.error("turned", list(turned), Message("kind-counts", bounds=f"1..{n_packs}"))
    return Drawing(table.count("rows", 1), tuple(pack - 1 for pack in order), tuple(pack - 1 for pack in turned))


def _sensors(table: TableReader, segments: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    table.check_names()
    n_cells = sum(segments)
    cells = table.values.get("cells")
    n_sensors = table.count("sensors", len(cells) if isinstance(cells, list) else n_cells)
    if isinstance(cells, list):
        return _listed(table, cells, n_sensors, n_cells)
    if cells not in (None, "each", "pack", "segment", "spread"):  # older profiles: `segment`
        raise table.error("cells", str(cells)[:60], Message("one-of-these", names=("each", "pack", "spread")))
    if n_sensors == 0:
        return ()
    if cells in ("pack", "segment"):
        if n_sensors % len(segments):
            raise table.error("sensors", n_sensors, Message("multiple-of-packs", n=len(segments)))
        return spread_in_packs(n_sensors, segments)
    if n_sensors == n_cells:
        return each_cell(n_cells)
    if cells == "each":
        raise table.error("cells", "each", Message("not-one-sensor-a-cell", sensors=n_sensors, cells=n_cells))
    return spread(n_sensors, range(n_cells))


def _listed(table: TableReader, cells: list[Any], n_sensors: int, n_cells: int) -> tuple[tuple[int, ...], ...]:
    if n_sensors != len(cells):
        raise table.error("sensors", n_sensors, Message("sensors-not-listed", lists=len(cells)))
    for entry in cells:
        if not isinstance(entry, list) or not all(type(cell) is int and 1 <= cell <= n_cells for cell in entry):
            raise table.error("cells", str(entry)[:60], Message("kind-counts", bounds=f"1..{n_cells}"))
    return tuple(tuple(cell - 1 for cell in entry) for entry in cells)


def _serial(document: Document, battery: Battery) -> SerialMapping | None:
    if "serial" not in document.values:
        return None
    if "source" in document.values:
        raise _table(document, "").error("source", "", Message("serial-or-source"))
    channels = dict.fromkeys(("voltage", "balancing", "resistance"), battery.n_cells)
    channels["temperature"] = battery.n_sensors
    return SerialTables(document.file, document.values["serial"], document.lines, channels).read()


def _source(document: Document) -> Source:
    table = _table(document, "source")
    if table.text("kind", "dbc") == "master":
        return MemoryMap()
    if table.text("kind", "dbc") == "table":
        return TableMapping(table.number("means_s", 0.0))
    table.check_names((*KINDS, *READINGS, "state"))
    values = table.values
    readings = {name: _reading(document, f"source.{name}") for name in READINGS if name in values}
    states = values.get("state", {})
    if not isinstance(states, Mapping) or not set(states) <= set(STATES):
        raise table.error("state", str(states)[:60], Message("no-such-key", names=STATES))
    return DbcMapping(
        dbc=table.texts("dbc"),
        cells={kind: _cell_signals(document, f"source.{kind}") for kind in KINDS if kind in values},
        states={name: _state(document, f"source.state.{name}") for name in states},
        period_s=table.number("period_s", 0.1),
        bit_rate=table.count("bit_rate", 0) or None,
        **readings,
    )


def _cell_signals(document: Document, path: str) -> tuple[CellSignals, ...]:
    name = path.rpartition(".")[2]
    given = document.values["source"][name]
    if not isinstance(given, list) or path not in MANY:
        raise _table(document, "source").error(name, str(given)[:60], Message("kind-tables", name=path))
    signals = []
    for i in range(len(given)):
        table = _table(document, path, i)
        table.check_names()
        signals.append(
            CellSignals(
                signal=table.pattern("signal"),
                message=table.pattern("message", "*"),
                numbers=table.parts("numbers"),
                base=table.bases("base"),
                group_cells=table.count("group_cells", 1),
                first=table.count("first", 1) - 1,
                order=tuple(count - 1 for count in table.counts("order") or ()),
                unit=table.text("unit"),
                scale=table.number("scale", 1.0),
                offset=table.number("offset", 0.0),
                invalid=table.counts("invalid") or (),
                invalid_signal=table.text("invalid_signal"),
                valid_signal=table.text("valid_signal"),
                valid_range=table.pair("valid_range"),
                checksum=table.text("checksum"),
                max_age_s=table.optional_number("max_age_s"),
                line=table.line,
            )
        )
    return tuple(signals)


def _reading(document: Document, path: str) -> ScalarSignal:
    table = _table(document, path)
    table.check_names()
    has_sign = any(field.name == "positive" for field in table.fields)
    return ScalarSignal(
        signal=table.signal("signal"),
        unit=table.text("unit"),
        positive="charge" if has_sign and table.text("positive", "discharge") == "charge" else "discharge",
        zero=table.number("zero", 0.0),
        max_age_s=table.optional_number("max_age_s"),
        line=table.line,
    )


def _state(document: Document, path: str) -> StateSignal:
    table = _table(document, path)
    table.check_names()
    return StateSignal(table.signal("signal"), table.counts("equals") or (1,), table.count("mask", 0), table.line)
