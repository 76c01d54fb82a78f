"""`voltwall battery`: profiles of batteries that are not the team's own, and what a battery of given cells can do."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from app.commands import battery_learn
from app.commands.arguments import Actions, chosen_cell, described
from app.commands.console import between, print_table, segments
from app.errors import ConfigError
from app.estimation.cell_model.default_cell import DEFAULT_CELL
from app.words import render

if TYPE_CHECKING:
    from app.battery.battery import Battery
    from app.battery.serial import SerialMapping
    from app.battery.sizing import Figure
    from app.battery.source import CellSignals, DbcMapping
    from app.battery.table_reader import ProfileError
    from app.estimation.cell_model.circuit import CellModel
    from app.sources.dbc.check import ProfileIssue

_MOST_PARALLEL = 1000
_NAMES = {"signal", "message", "numbers"}  # fields of an entry that name what is in the DBC


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for add in (_add_show, _add_check, battery_learn.add_arguments, _add_size):
        add(actions)


def _add_show(actions: Actions) -> None:
    """Declare the actions."""
    listing = actions.add_parser("list", **described("list the bundled profiles"))
    listing.add_argument("--json", action="store_true", help="print JSON")
    listing.set_defaults(run=_list)
    showing = actions.add_parser("show", **described("show a profile, with a drawing of the layout"))
    showing.add_argument("profile", metavar="NAME|FILE", help="bundled profile or TOML file")
    showing.add_argument("--toml", action="store_true", help="print the profile as TOML")
    showing.set_defaults(run=_show)


def _add_check(actions: Actions) -> None:
    """Declare the action."""
    checking = actions.add_parser(
        "check",
        **described(
            "check a profile and its DBC by line and field; exit code 1 with warnings, 2 if the profile cannot be used"
        ),
    )
    checking.add_argument("--json", action="store_true", help="print JSON")
    checking.add_argument("profile", metavar="NAME|FILE", help="bundled profile or TOML file")
    checking.add_argument(
        "--log",
        type=Path,
        metavar="FILE",
        help="check against a CAN log of this battery (.log of candump, .trc, .asc, .blf, .mf4), or the bytes of its "
        "serial line (binary or hex)",
    )
    battery_learn.add_bus_argument(checking)
    checking.set_defaults(run=_check)


def _add_size(actions: Actions) -> None:
    """Declare the action."""
    sizing = actions.add_parser(
        "size",
        **described("calculate voltage, capacity, energy, mass, currents, power and resistance of a battery"),
    )
    sizing.add_argument(
        "--cell", default=DEFAULT_CELL, metavar="CELL.toml",
        help="cell file (TOML) or bundled cell (default: %(default)s)",
    )  # fmt: skip
    sizing.add_argument(
        "--packs", "--segments", dest="segments", type=segments, required=True, metavar="8x12",
        help="packs x series cells per pack",
    )  # fmt: skip
    sizing.add_argument(
        "--parallel", type=_parallel, default=1, metavar="N",
        help="cells in parallel (default: 1)",
    )  # fmt: skip
    sizing.add_argument(
        "--soc", type=between(0, 100, "percent"), default=50.0, metavar="PERCENT",
        help="SOC for power and resistance (default: 50)",
    )  # fmt: skip
    sizing.add_argument(
        "--temperature", type=float, default=25.0, metavar="DEGC",
        help="cell temperature for power and resistance (default: 25)",
    )  # fmt: skip
    sizing.add_argument("--json", action="store_true", help="print JSON")
    sizing.set_defaults(run=_size)


def _parallel(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= _MOST_PARALLEL:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 to {_MOST_PARALLEL}")
    return int(text)


def _list(args: argparse.Namespace) -> int:
    """Print the profiles that come along."""
    from app.battery.library import bundled_profiles, load_part, load_profile
    from app.battery.table_reader import ProfileError

    listed: list[dict[str, object]] = []
    for name in bundled_profiles():
        try:
            battery = load_profile(name).profile.battery
        except ProfileError:
            load_part(name)
            listed.append({"profile": name, "name": None})
            continue
        numbers = {"segments": battery.n_packs, "cells": battery.n_cells, "sensors": battery.n_sensors}
        listed.append({"profile": name, "name": battery.name, **numbers})
    if args.json:
        print(json.dumps(listed, indent=2))
        return 0
    rows = []
    for row in listed:
        text = "only for include in another profile"
        if row["name"] is not None:
            text = f"{row['name']}: {row['segments']} packs, {row['sensors']} temperature sensors"
        rows.append((str(row["profile"]), text))
    print_table((), rows)
    return 0


def _show(args: argparse.Namespace) -> int:
    """Print what one means."""
    from app.battery.library import load_profile
    from app.battery.serial import SerialMapping
    from app.battery.source import DbcMapping, MemoryMap

    loaded = load_profile(args.profile)
    if args.toml:
        print(loaded.text, end="")
        return 0
    battery, source = loaded.profile.battery, loaded.profile.source
    _show_battery(battery)
    if isinstance(source, MemoryMap):
        print("source: the built-in master, over RS232 and CAN")
    elif isinstance(source, DbcMapping):
        _show_source(source)
    elif isinstance(source, SerialMapping):
        _show_serial(source)
    return 0


def _show_battery(battery: Battery) -> None:
    from app.battery.drawing import drawn, sensors_in_words

    print(f"{battery.name}: {battery.n_cells} cells in {battery.n_packs} packs, {battery.parallel} in parallel")
    print(f"cell: {battery.cell}")
    print("packs on the map, with their cells:")
    print("\n".join(drawn(battery)))
    print(f"temperature sensors: {sensors_in_words(battery)}")
    for title, values in (("limits", battery.limits), ("rules", battery.rules)):
        if values:
            print(f"{title}: " + ", ".join(f"{name} = {value}" for name, value in values.items()))


def _show_source(source: DbcMapping) -> None:
    print(f"source: CAN by {', '.join(source.dbc)}")
    for kind, entries in source.cells.items():
        for entry in entries:
            print(f"  {kind}: {_in_words(entry)}")
    for name in ("current", "pack_voltage", "soc", "charger_voltage", "charger_current"):
        reading = getattr(source, name)
        if reading is not None:
            sign = f", positive on {reading.positive}" if "current" in name else ""
            print(f"  {name}: {reading.signal}{sign}")
    for name, state in source.states.items():
        wanted = f"one of the bits {state.mask:#x}" if state.mask else f"{' or '.join(map(str, state.equals))}"
        print(f"  {name}: where {state.signal} is {wanted}")


def _show_serial(source: SerialMapping) -> None:
    port = source.port
    print(f"source: serial, {port.baud} bit/s, {port.data_bits} data bits, parity {port.parity}")
    for part in source.parts:
        checksum = getattr(part, "checksum", None)
        request = f", requested every {part.poll_s:g} s" if part.poll else ""
        print(f"  {part.name}: {'no checksum' if checksum is None else checksum.kind}{request}")
        for field in part.fields:
            print(f"    {field.name}: {field.count} {field.kind}, raw * {field.scale:g} + {field.offset:g}")


def _in_words(entry: CellSignals) -> str:
    parts = [f"signals {entry.signal}" + ("" if entry.message == "*" else f" of messages {entry.message}")]
    parts += [f"{part} by signal {signal} of the frame" for part, signal in entry.numbers.items()]
    bases = {part: low for part, low in entry.base.items() if low}
    if bases:
        parts.append("counted from " + ", ".join(f"{low} ({part})" for part, low in bases.items()))
    if entry.group_cells > 1:
        parts.append(f"{entry.group_cells} cells per group")
    if entry.checksum:
        parts.append(f"checksum {entry.checksum}")
    age = "three periods" if entry.max_age_s is None else f"{entry.max_age_s:g} s"
    parts.append(f"values older than {age} count as missing")
    return "; ".join(parts)


def _check(args: argparse.Namespace) -> int:
    """Print every warning; 1 where there is one, 2 if the profile cannot be used."""
    from app.battery.library import load_part
    from app.battery.profile_errors import errors_of
    from app.battery.serial import SerialMapping
    from app.battery.source import DbcMapping

    document = load_part(args.profile)
    errors, profile = errors_of(document)
    entries = [_entry("error", error.file, error.line, error.path, _of_field(error)) for error in errors]
    n_errors, n_warnings = len(errors), 0
    if profile is not None:
        warnings = _of_cell(profile.battery.cell, profile.file)
        if isinstance(profile.source, DbcMapping):
            warnings += _of_dbc(profile.battery, profile.source, profile.file, args)
        elif isinstance(profile.source, SerialMapping):
            warnings += _of_serial(profile.battery, profile.source, profile.file, args)
        elif not args.json:
            print(f"{profile.file}: the built-in master, without a DBC to check")
        if errors:  # warnings would be of what was set aside
            warnings = [warning for warning in warnings if warning.is_error and not _is_known(warning.field, errors)]
        for warning in warnings:
            kind = "error" if warning.is_error else "warning"
            text = f"{warning.field}: {render(warning.what)}"
            entries.append(_entry(kind, warning.file, warning.line, warning.field, text))
        n_errors += sum(warning.is_error for warning in warnings)
        n_warnings = len(warnings) - (n_errors - len(errors))
    code = 2 if n_errors else int(bool(n_warnings))
    if args.json:
        print(json.dumps(entries, indent=2))
        return code
    for entry in entries:
        place = entry["file"] if entry["line"] is None else f"{entry['file']}:{entry['line']}"
        print(f"{place}: {entry['kind']}: {entry['text']}")
    cells = "" if profile is None or errors else f"{profile.battery.n_cells} cells, "
    print(f"{cells}{n_errors} errors, {n_warnings} warnings")
    return code


def _entry(kind: str, file: str, line: int | None, field: str, text: str) -> dict[str, object]:
    return {"kind": kind, "file": file, "line": line, "field": field, "text": text}


def _of_field(error: ProfileError) -> str:
    value = f" = {error.value}" if str(error.value) else ""
    return f"{error.path}{value}: {render(error.limit)}"


def _is_known(field: str, errors: list[ProfileError]) -> bool:
    """Whether a field has an error that was printed: its own, or of a name in the same table."""
    table = f"{field.rpartition('.')[0]}."
    return any(
        error.path == field or (error.path.startswith(table) and set(error.path[len(table) :].split(".")) & _NAMES)
        for error in errors
    )


def _of_dbc(battery: Battery, source: DbcMapping, file: str, args: argparse.Namespace) -> list[ProfileIssue]:
    """Warnings of the files that the profile names, and of what it says of them."""
    from app.sources.dbc.check import ProfileIssue, issues_of
    from app.sources.recordings.buses import Buses

    missing = [Path(name) for name in source.dbc if not Path(name).is_file()]
    if missing:
        return [ProfileIssue(file, None, "source.dbc", f"no such file: {name}", is_error=True) for name in missing]
    definitions = battery_learn.definitions_of(map(Path, source.dbc))
    frames = None
    if args.log is not None:
        buses = Buses(args.bus)
        frames = battery_learn.log_frames(args.log, buses)
        buses.check(args.log.name, definitions.by_id())
    return issues_of(battery, source, definitions, file, frames)


def _of_serial(battery: Battery, mapping: SerialMapping, file: str, args: argparse.Namespace) -> list[ProfileIssue]:
    """Warnings of serial tables; with captured bytes also prints what they hold."""
    from app.sources.serial.check import captured_bytes, serial_issues, shown_values

    try:
        capture = None if args.log is None else captured_bytes(args.log, battery, mapping)
    except (OSError, ValueError) as error:
        raise ConfigError("log", args.log, getattr(error, "strerror", None) or str(error)) from error
    warnings = serial_issues(battery, mapping, file, capture)
    if capture is not None and not args.json and not any(warning.is_error for warning in warnings):
        print("\n".join(shown_values(battery, mapping, capture)))
    return warnings


def _of_cell(cell: str, file: str) -> list[ProfileIssue]:
    from app.estimation.cell_model.cell_file import load_cell
    from app.estimation.errors import CellFileError
    from app.sources.dbc.check import ProfileIssue

    try:
        load_cell(cell)
    except CellFileError as error:
        return [ProfileIssue(file, None, "battery.cell", str(error), is_error=True)]
    return []


def _size(args: argparse.Namespace) -> int:
    """Print what a battery of these cells can do."""
    from app.battery.sizing import CellLayout, figures_of

    cell = chosen_cell(args.cell)
    _check_temperature(cell, args.temperature)
    n_segments, n_in_series = args.segments
    layout = CellLayout(n_segments, n_in_series, args.parallel)
    figures = figures_of(cell, layout, args.soc / 100.0, args.temperature)
    if args.json:
        document = {
            "cell": {"name": cell.name, "source": cell.source},
            "layout": asdict(layout),
            "soc": args.soc / 100.0,
            "temperature_degc": args.temperature,
            "figures": {name: asdict(figure) for name, figure in figures.items()},
        }
        print(json.dumps(document, indent=2, allow_nan=False))
        return 0
    print(f"{cell.name}: {layout.n_segments} packs of {layout.n_in_series} in series, {layout.n_parallel} in parallel")
    print(f"{'':36}{'cell':>9}{'pack':>10}{'battery':>10}")
    for figure in figures.values():
        print(_size_line(figure))
    return 0


def _size_line(figure: Figure) -> str:
    begin = f"{figure.title:30}{figure.unit:>6}"
    if figure.cell is None or figure.segment is None or figure.battery is None:
        return f"{begin}  not known: the cell file has no {', '.join(figure.missing)}"
    values = (f"{figure.cell:.4g}", f"{figure.segment:.4g}", f"{figure.battery:.4g}")
    return f"{begin}{values[0]:>9}{values[1]:>10}{values[2]:>10}  {figure.condition}"


def _check_temperature(cell: CellModel, degc: float) -> None:
    low, high = cell.limits.temperature_min_degc, cell.limits.temperature_max_degc
    low, high = -60.0 if low is None else low, 150.0 if high is None else high
    if not low <= degc <= high:
        raise ConfigError("temperature", degc, f"{low:g} to {high:g} degC, by the cell file")
