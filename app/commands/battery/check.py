"""`voltwall battery check`: every doubt of a profile, its DBC, and what a log says of both."""

import argparse
import json
from pathlib import Path

from app.battery.battery import Battery
from app.battery.library import load_part
from app.battery.profile_errors import errors_of
from app.battery.source import SpeaksDbc, SpeaksMaster
from app.battery.table_reader import ProfileError
from app.commands.battery.inputs import definitions_of, log_frames
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import CellFileError
from app.sources.dbc.check import Doubt, doubts_of
from app.words import render

_NAMES = {"signal", "message", "numbers"}  # fields of an entry that name what is in the DBC


def check(args: argparse.Namespace) -> int:
    """Print every doubt; 1 where there is one, 2 where the profile cannot work."""
    document = load_part(args.profile)
    errors, profile = errors_of(document)
    found = [_entry("error", error.file, error.line, error.path, _of_field(error)) for error in errors]
    n_errors, n_doubts = len(errors), 0
    if profile is not None:
        doubts = _of_cell(profile.battery.cell, profile.file)
        if isinstance(profile.source, SpeaksMaster):
            if not args.json:
                print(f"{profile.file}: the team's own master; nothing of a DBC to check")
        else:
            doubts += _of_dbc(profile.battery, profile.source, profile.file, args.log)
        if errors:  # doubts would be of what was set aside
            doubts = [doubt for doubt in doubts if doubt.is_error and not _is_known(doubt.field, errors)]
        for doubt in doubts:
            kind = "error" if doubt.is_error else "doubt"
            text = f"{doubt.field}: {render(doubt.what)}"
            found.append(_entry(kind, doubt.file, doubt.line, doubt.field, text))
        n_errors += sum(doubt.is_error for doubt in doubts)
        n_doubts = len(doubts) - (n_errors - len(errors))
    code = 2 if n_errors else int(bool(n_doubts))
    if args.json:
        print(json.dumps(found, indent=2))
        return code
    for each in found:
        place = each["file"] if each["line"] is None else f"{each['file']}:{each['line']}"
        print(f"{place}: {each['kind']}: {each['text']}")
    cells = "" if profile is None or errors else f"{profile.battery.n_cells} cells, "
    print(f"{cells}{n_errors} errors, {n_doubts} doubts")
    return code


def _entry(kind: str, file: str, line: int | None, field: str, text: str) -> dict[str, object]:
    return {"kind": kind, "file": file, "line": line, "field": field, "text": text}


def _of_field(error: ProfileError) -> str:
    value = f" = {error.value}" if str(error.value) else ""
    return f"{error.path}{value}: {render(error.limit)}"


def _is_known(field: str, errors: list[ProfileError]) -> bool:
    """What can be said of a field comes from an error that was told: its own, or of a name in the same table."""
    table = f"{field.rpartition('.')[0]}."
    return any(
        error.path == field or (error.path.startswith(table) and set(error.path[len(table) :].split(".")) & _NAMES)
        for error in errors
    )


def _of_dbc(battery: Battery, source: SpeaksDbc, file: str, log: Path | None) -> list[Doubt]:
    """Doubts of the files that the profile names, and of what it says of them."""
    missing = [Path(name) for name in source.dbc if not Path(name).is_file()]
    if missing:
        return [Doubt(file, None, "source.dbc", f"no such file: {name}", is_error=True) for name in missing]
    definitions = definitions_of(map(Path, source.dbc))
    return doubts_of(battery, source, definitions, file, None if log is None else log_frames(log))


def _of_cell(cell: str, file: str) -> list[Doubt]:
    try:
        load_cell(cell)
    except CellFileError as error:
        return [Doubt(file, None, "battery.cell", str(error), is_error=True)]
    return []
