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


def add_data_argument(parser: argparse.ArgumentParser, default: object = None) -> None:
    """Declare --data; below another parser that has it, with argparse.SUPPRESS as its default."""
    parser.add_argument("--data", type=Path, metavar="DIR", default=default, help="data folder of the service")


def new_action(actions: "argparse._SubParsersAction[argparse.ArgumentParser]", name: str, text: str, do: Action) -> (
    argparse.ArgumentParser
):  # fmt: skip
    """Return the parser of one more action, with --data, that does `do`."""
    parser = actions.add_parser(
        name, help=text, description=text[0].upper() + text[1:] + ".", formatter_class=argparse.RawTextHelpFormatter
    )
    add_data_argument(parser, argparse.SUPPRESS)
    parser.set_defaults(do=do)
    return parser


def add_session_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the session."""
    parser.add_argument("session", metavar="SESSION", help="the session's id, or its file")


def add_json_argument(parser: argparse.ArgumentParser, default: object = argparse.SUPPRESS) -> None:
    """Declare --json."""
    parser.add_argument("--json", action="store_true", default=default, help="as JSON")


def add_car_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare whose sessions are meant."""
    parser.add_argument("--battery", metavar="NAME|FILE", help="of this battery (default: the one that is served)")
    parser.add_argument("--simulated", action="store_true", help="of the simulated car")


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
