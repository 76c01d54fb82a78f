"""The season of a data folder, as the commands on it need it."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from app.analysis.passport.keeper import PassportKeeper
from app.battery.battery import Battery
from app.commands.session_commands.selection import catalogue, data_folder
from app.errors import ConfigError
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError
from app.season.cells.keeper import SeasonKeeper
from app.service.settings import Settings
from app.sources.loaded_battery import load_battery
from app.words import naming_cells


def add_car_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare whose season it is."""
    parser.add_argument("--battery", metavar="NAME|FILE", help="of this battery (default: the one that is served)")
    parser.add_argument("--simulated", action="store_true", help="of the simulated car")


@contextmanager
def kept_season(args: argparse.Namespace) -> Iterator[tuple[SeasonKeeper, Battery]]:
    """Read and estimate what is new, and give the season; cells are named as the battery's.

    Raises:
        AppError: the data folder, the battery or its cell file cannot be used.
    """
    settings = Settings.model_validate({})
    battery = load_battery(args.battery or settings.battery).battery
    name = settings.cell or battery.cell
    try:
        cell = load_cell(name)
    except EstimatorError as error:
        raise ConfigError("cell", name, str(error)) from error
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
