"""`voltwall sessions import` and `columns`: other systems' recordings, and CAN logs, as sessions."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.commands.arguments import (
    Actions,
    add_json_argument,
    add_means_argument,
    data_folder,
    existing,
    new_action,
    unix_s,
)
from app.commands.battery_learn import add_bus_argument
from app.commands.console import Progress, printable
from app.errors import ConfigError
from app.estimation.filters.filter_names import FILTERS
from app.words import render

if TYPE_CHECKING:
    from app.estimation.arrays import FloatArray
    from app.sources.recordings.import_mapping import ImportMapping, ImportMappingStore
    from app.sources.recordings.table import Table

_NUMBERS = ("max_rate_hz", "hold_s", "cells_in_series")


def add_arguments(actions: Actions) -> None:
    """Declare the actions."""
    taking = new_action(
        actions, "import", "import a recording of another system as a session, with estimates", import_recording
    )
    taking.epilog = (
        "Formats (detected by content): CSV, Parquet; CAN logs: candump, .asc, .blf, .trc, SavvyCAN, CRTD, .mf4.\n"
        "A CAN log needs --battery (default: the built-in master) or --dbc, which reads its signals as a table.\n"
        "A table has the packs of --battery, else one pack."
    )
    text = "show the columns of a recording and the suggested profile"
    columns = new_action(actions, "columns", text, show_columns)
    for action in (taking, columns):
        action.add_argument("file", type=Path, metavar="FILE", help="recording")
        action.add_argument("--dbc", type=Path, metavar="FILE", help="DBC of the CAN frames")
    add_json_argument(columns)
    add_bus_argument(taking)
    taking.add_argument("--battery", metavar="NAME|FILE", help="battery profile of the CAN log or table")
    taking.add_argument("--profile", metavar="NAME|FILE", help="column assignment: saved profile or TOML file")
    taking.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="FIELD=VALUE",
        help="change the profile, such as voltages='Cell {n} V', current='Pack I', charge_positive=true",
    )
    add_means_argument(taking, None)
    taking.add_argument("--save-profile", metavar="NAME", help="save the profile under this name")
    taking.add_argument("--name", default="", help="session name (default: the file's name)")
    taking.add_argument("--start", metavar="TIME", help="start time (ISO 8601) if the file has none")
    taking.add_argument("--filter", choices=FILTERS, default="fused", help="state estimator (default: fused)")
    taking.add_argument("--cell", metavar="CELL.toml", help="cell file or bundled cell (default: that of the battery)")


def import_recording(args: argparse.Namespace) -> int:
    """Make a session of a recording."""
    from app.live.pipeline_factory import PipelineFactory
    from app.sessions.transfer.import_session import READING_TABLE, between, import_file
    from app.sources.loaded_battery import load_battery
    from app.sources.recordings.import_mapping import ImportMapping, ImportMappingStore
    from app.sources.recordings.kind import is_can_log
    from app.sources.recordings.table import read_table

    path = existing("file", args.file)
    data = data_folder(args)
    battery = None if args.battery is None else load_battery(args.battery)
    store = ImportMappingStore(data / "profiles")
    is_log = args.dbc is None and is_can_log(path)
    has_table = args.dbc is None and not is_log
    with Progress(path.name) as progress:
        table = read_table(path, between(progress, 0.0, READING_TABLE)) if has_table else None
        mapping = ImportMapping() if is_log else _mapping(args, table, store)
        mapping = replace(mapping, bus=args.bus) if args.bus else mapping
        done = import_file(
            path,
            mapping,
            data / "sessions",
            lambda of: PipelineFactory(args.filter, args.cell, of).pipeline(
                "replay", "imported", "imported", predicts=False
            ),
            battery=battery,
            dbc=args.dbc,
            table=table,
            name=args.name,
            started_unix_s=None if args.start is None else unix_s("start", args.start),
            on_progress=progress,
        )
    for note in done.notes:
        print(render(note), file=sys.stderr)
    if args.save_profile:
        store.save(args.save_profile, mapping)
    rows = f"{done.rows} {'frames' if is_log else 'rows'}"
    of = f" of {done.cells} cells" if done.cells else ""
    print(f"{done.info.id}: {rows}{of}, {done.info.duration_s / 60:.1f} min")
    return 0


def show_columns(args: argparse.Namespace) -> int:
    """Print what is in a recording."""
    from app.sources.recordings.guess import guess
    from app.sources.recordings.import_mapping import mapping_text
    from app.sources.recordings.log_signals import read_signals
    from app.sources.recordings.table import read_table

    path = existing("file", args.file)
    if args.dbc is not None:
        signals = sorted(read_signals(path, args.dbc).by_name)
        print(json.dumps({"signals": signals}, indent=2) if args.json else "\n".join(signals))
        return 0
    table = read_table(path)
    columns = [_span(name, values) for name, values in table.columns.items()]
    if args.json:
        notes = [render(note) for note in table.notes]
        print(json.dumps({"columns": columns, "notes": notes, "profile": asdict(guess(table))}, indent=2))
        return 0
    for i, column in enumerate(columns, 1):
        span = "empty" if column["lowest"] is None else f"{column['lowest']:.6g} to {column['highest']:.6g}"
        print(printable(f"{i:>4}  {column['name']}: {span}"))
    for note in table.notes:
        print(f"# {render(note)}")
    print("# guessed profile\n" + mapping_text(guess(table)), end="")
    return 0


def _span(name: str, values: FloatArray) -> dict[str, Any]:
    finite = [value for value in values.tolist() if math.isfinite(value)]
    lowest, highest = (min(finite), max(finite)) if finite else (None, None)
    return {"name": name, "lowest": lowest, "highest": highest}


def _mapping(args: argparse.Namespace, table: Table | None, store: ImportMappingStore) -> ImportMapping:
    from app.sources.recordings.guess import guess
    from app.sources.recordings.import_mapping import ImportMapping, mapping_of, parse_mapping

    if args.profile is None:
        mapping = ImportMapping() if table is None else guess(table)
    elif Path(args.profile).is_file():
        mapping = parse_mapping(Path(args.profile).read_text(encoding="utf-8"), args.profile)
    else:
        mapping = store.load(args.profile)
    given: dict[str, object] = {} if args.current_means is None else {"current_means": args.current_means}
    for text in args.set:
        name, sign, value = text.partition("=")
        if not sign:
            raise ConfigError("set", text, "FIELD=VALUE")
        given[name] = _value(name, value)
    return replace(mapping, **given) if mapping_of(given) else mapping  # type: ignore[arg-type]


def _value(name: str, text: str) -> object:
    if name == "charge_positive":
        return text.lower() in ("true", "yes", "1")
    if name in _NUMBERS:
        try:
            return float(text)
        except ValueError as error:
            raise ConfigError(name, text, "a number") from error
    return text
