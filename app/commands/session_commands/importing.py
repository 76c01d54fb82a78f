"""`voltwall sessions import`: other systems' recordings, and CAN logs, as sessions."""

import argparse
import json
import sys
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from app.commands.console.progress import Progress
from app.commands.console.terminal import printable
from app.commands.session_commands.selection import data_folder
from app.errors import ConfigError
from app.estimation.arrays import FloatArray
from app.live.pipeline_factory import PipelineFactory
from app.sessions.transfer.import_session import READING_TABLE, between, import_file
from app.sources.loaded_battery import load_battery
from app.sources.recordings.can_log import read_signals
from app.sources.recordings.guess import guess
from app.sources.recordings.kind import is_can_log
from app.sources.recordings.profile import ImportProfile, ProfileStore, parse_profile, profile_of, profile_text
from app.sources.recordings.table import Table, read_table
from app.words import render

_NUMBERS = ("max_rate_hz", "hold_s", "cells_in_series")


def import_recording(args: argparse.Namespace) -> int:
    """Make a session of a recording."""
    path = _existing(args.file)
    data = data_folder(args)
    battery = None if args.battery is None else load_battery(args.battery)
    store = ProfileStore(data / "profiles")
    is_log = args.dbc is None and is_can_log(path)
    progress = Progress(path.name)
    has_table = args.dbc is None and not is_log
    table = read_table(path, between(progress, 0.0, READING_TABLE)) if has_table else None
    profile = ImportProfile() if is_log else _profile(args, table, store)
    done = import_file(
        path,
        profile,
        data / "sessions",
        lambda of: PipelineFactory(args.filter, args.cell, of).pipeline(
            "replay", "imported", "imported", looks_ahead=False
        ),
        battery=battery,
        dbc=args.dbc,
        table=table,
        name=args.name,
        started_unix_s=_start(args.start),
        on_progress=progress,
    )
    progress.end()
    for note in done.notes:
        print(render(note), file=sys.stderr)
    if args.save_profile:
        store.save(args.save_profile, profile)
    rows = f"{done.rows} {'frames' if is_log else 'rows'}"
    of = f" of {done.cells} cells" if done.cells else ""
    print(f"{done.info.id}: {rows}{of}, {done.info.duration_s / 60:.1f} min")
    return 0


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise ConfigError("file", path, "no such file")
    return path


def show_columns(args: argparse.Namespace) -> int:
    """Print what is in a recording."""
    path = _existing(args.file)
    if args.dbc is not None:
        signals = sorted(read_signals(path, args.dbc).found)
        print(json.dumps({"signals": signals}, indent=2) if args.json else "\n".join(signals))
        return 0
    table = read_table(path)
    columns = [_span(name, values) for name, values in table.columns.items()]
    if args.json:
        notes = [render(note) for note in table.notes]
        print(json.dumps({"columns": columns, "notes": notes, "profile": asdict(guess(table))}, indent=2))
        return 0
    for i, each in enumerate(columns, 1):
        span = "empty" if each["lowest"] is None else f"{each['lowest']:.6g} to {each['highest']:.6g}"
        print(printable(f"{i:>4}  {each['name']}: {span}"))
    for note in table.notes:
        print(f"# {render(note)}")
    print("# guessed profile\n" + profile_text(guess(table)), end="")
    return 0


def _span(name: str, values: FloatArray) -> dict[str, Any]:
    known = values[np.isfinite(values)]
    lowest, highest = (float(known.min()), float(known.max())) if len(known) else (None, None)
    return {"name": name, "lowest": lowest, "highest": highest}


def _profile(args: argparse.Namespace, table: Table | None, store: ProfileStore) -> ImportProfile:
    if args.profile is None:
        profile = ImportProfile() if table is None else guess(table)
    elif Path(args.profile).is_file():
        profile = parse_profile(Path(args.profile).read_text(encoding="utf-8"), args.profile)
    else:
        profile = store.load(args.profile)
    given: dict[str, object] = {}
    for text in args.set:
        name, sign, value = text.partition("=")
        if not sign:
            raise ConfigError("set", text, "FIELD=VALUE")
        given[name] = _value(name, value)
    return replace(profile, **given) if profile_of(given) else profile  # type: ignore[arg-type]


def _value(name: str, text: str) -> object:
    if name == "charge_positive":
        return text.lower() in ("true", "yes", "1")
    if name in _NUMBERS:
        try:
            return float(text)
        except ValueError as error:
            raise ConfigError(name, text, "a number") from error
    return text


def _start(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        time = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError("start", text, "ISO 8601, like 2026-07-14T10:30:00Z") from error
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()
