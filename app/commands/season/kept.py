"""The season of a data folder, as the commands on it need it."""

import argparse
import sys

from app.commands.season.build import built_lake, lake_of
from app.commands.session_commands.selection import chosen_battery, data_folder
from app.season.cells.history import SeasonSource
from app.season.lake.place import Place
from app.sessions.swaps import SwapFile


def kept_season(args: argparse.Namespace) -> SeasonSource:
    """Bring the lake up to date with the data folder, and return its season.

    Raises:
        AppError: the data folder, the lake, the battery or its cell file cannot be used.
    """
    battery, cell = chosen_battery(args)
    folder, lake = data_folder(args), lake_of(args)
    if (folder / "sessions").is_dir():
        built_lake(Place(lake), [folder / "sessions"], shows=sys.stderr.isatty())
    swaps = SwapFile(folder, battery, simulated=args.simulated).read()
    return SeasonSource(lake, battery, args.simulated, cell, tuple(swaps))
