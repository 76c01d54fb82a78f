"""`voltwall battery check`: every doubt of a profile, its DBC, and what a log says of both."""

import argparse
from pathlib import Path

from app.battery.library import load_profile
from app.battery.source import SpeaksMaster
from app.commands.battery_commands.inputs import definitions_of, log_frames
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import CellFileError
from app.sources.dbc.check import Doubt, doubts_of
from app.words import render


def add_actions(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    checking = actions.add_parser(
        "check",
        help="every doubt of a profile and its DBC, by line and field; exit code 1 where there is one,\n"
        "2 where the profile cannot work",
        formatter_class=argparse.RawTextHelpFormatter,
    )
    checking.add_argument("profile", metavar="NAME|FILE", help="a bundled profile, or a TOML file")
    checking.add_argument(
        "--log", type=Path, metavar="FILE", help="a CAN log of this battery: .log (candump), .trc, .asc, .blf, .mf4"
    )
    checking.set_defaults(do=_check)


def _check(args: argparse.Namespace) -> int:
    loaded = load_profile(args.profile)
    profile = loaded.profile
    doubts = _of_cell(profile.battery.cell, profile.file)
    if isinstance(profile.source, SpeaksMaster):
        print(f"{profile.file}: the team's own master; nothing of a DBC to check")
    else:
        definitions = definitions_of(loaded.dbc_files)
        frames = None if args.log is None else log_frames(args.log)
        doubts += doubts_of(profile.battery, profile.source, definitions, profile.file, frames)
    for doubt in doubts:
        place = doubt.file if doubt.line is None else f"{doubt.file}:{doubt.line}"
        print(f"{place}: {'error' if doubt.is_error else 'doubt'}: {doubt.field}: {render(doubt.what)}")
    n_errors = sum(doubt.is_error for doubt in doubts)
    print(f"{profile.battery.n_cells} cells, {n_errors} errors, {len(doubts) - n_errors} doubts")
    return 2 if n_errors else int(bool(doubts))


def _of_cell(cell: str, file: str) -> list[Doubt]:
    try:
        load_cell(cell)
    except CellFileError as error:
        return [Doubt(file, None, "battery.cell", str(error), is_error=True)]
    return []
