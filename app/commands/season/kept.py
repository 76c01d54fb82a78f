"""The season of a data folder, as the commands on it need it."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from app.analysis.passport.keeper import PassportKeeper
from app.battery.battery import Battery
from app.commands.session_commands.selection import catalogue, chosen_battery, data_folder
from app.season.cells.keeper import SeasonKeeper
from app.words import naming_cells


@contextmanager
def kept_season(args: argparse.Namespace) -> Iterator[tuple[SeasonKeeper, Battery]]:
    """Read and estimate what is new, and give the season; cells are named as the battery's.

    Raises:
        AppError: the data folder, the battery or its cell file cannot be used.
    """
    battery, cell = chosen_battery(args)
    sessions = catalogue(args)
    passports = PassportKeeper(data_folder(args), sessions, cell, battery=battery, simulated=args.simulated)
    keeper = SeasonKeeper(data_folder(args), sessions, passports, cell)
    try:
        keeper.read_new()
        with naming_cells(battery.segments):
            yield keeper, battery
    finally:
        keeper.close()
        passports.close()
