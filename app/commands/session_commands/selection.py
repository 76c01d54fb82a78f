"""Where the commands on recorded sessions find them: the data folder, and a session by its id or its file."""

import argparse
from collections.abc import Callable
from pathlib import Path

from app.battery.battery import Battery
from app.errors import ConfigError
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.service.settings import Settings
from app.sessions.catalogue import Catalogue
from app.sources.loaded_battery import load_battery

Action = Callable[[argparse.Namespace], int]


def chosen_battery(args: argparse.Namespace) -> tuple[Battery, CellModel]:
    """Return whose sessions are meant, with its cell.

    Raises:
        AppError: the battery or its cell file cannot be used.
    """
    settings = Settings.model_validate({})
    battery = load_battery(args.battery or settings.battery).battery
    name = settings.cell or battery.cell
    try:
        return battery, load_cell(name)
    except EstimatorError as error:
        raise ConfigError("cell", name, str(error)) from error


def data_folder(args: argparse.Namespace) -> Path:
    """Return the data folder: the one chosen, else the service's."""
    chosen: Path | None = args.data
    return chosen if chosen is not None else Settings.model_validate({}).data


def catalogue(args: argparse.Namespace) -> Catalogue:
    """Return the sessions of the data folder."""
    return Catalogue(data_folder(args) / "sessions")


def find_session(args: argparse.Namespace, session: str) -> Path:
    """Return the file of a session given by id or by path.

    Raises:
        SessionNotFound: neither is there.
    """
    path = Path(session)
    return path if path.is_file() else catalogue(args).path(session)
