"""Arguments that several commands have, and what they mean: the data folder, a session, a battery, a cell, a time."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypedDict

from app.errors import ConfigError
from app.estimation.recording.means_choices import CHOICES
from app.words import Message
from firmware_protocol.names import closest

if TYPE_CHECKING:
    from app.battery.battery import Battery
    from app.estimation.cell_model.circuit import CellModel
    from app.estimation.recording.cell_recording import Recording
    from app.sessions.catalogue import Catalogue

Actions: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
Run = Callable[[argparse.Namespace], int]


class Described(TypedDict):
    """The texts of an action, for the list of its command and for its own help."""

    help: str
    description: str


def described(text: str) -> Described:
    """Return both texts of an action from its text in the list, which has no capital and no stop."""
    return {"help": text, "description": text[0].upper() + text[1:] + "."}


def add_data_argument(parser: argparse.ArgumentParser, default: object = None) -> None:
    """Declare --data; below another parser that has it, with argparse.SUPPRESS as its default."""
    parser.add_argument("--data", type=Path, metavar="DIR", default=default, help="data folder of the service")


def new_action(actions: Actions, name: str, text: str, run: Run) -> argparse.ArgumentParser:
    """Return the parser of one more action, with --data, that does this work."""
    parser = actions.add_parser(name, **described(text), formatter_class=argparse.RawTextHelpFormatter)
    add_data_argument(parser, argparse.SUPPRESS)
    parser.set_defaults(run=run)
    return parser


def add_session_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the session."""
    parser.add_argument("session", metavar="SESSION", help="session ID or file")


def add_json_argument(parser: argparse.ArgumentParser, default: object = argparse.SUPPRESS) -> None:
    """Declare --json."""
    parser.add_argument("--json", action="store_true", default=default, help="print JSON")


def add_trust_argument(parser: argparse.ArgumentParser) -> None:
    """Declare whose certificate is trusted."""
    parser.add_argument(
        "--trust",
        metavar="FILE|FINGERPRINT",
        help="certificate to trust for https: a PEM file or its SHA-256 (default: VOLTWALL_TRUST, else the system's)",
    )


def add_reading_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare how columns, signs and a missing clock of the user's files are to be read."""
    group = parser.add_argument_group("file format")
    group.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="[FILE:]FIELD=COLUMN[*FACTOR],...",
        help="assign columns by header text or number from 1; fields: time_s, current_a, voltage_v, "
        "temperature_c, soc; put FILE: in front to limit it to one file",
    )
    group.add_argument("--charge-positive", action="store_true", help="charging current is positive in the files")
    group.add_argument(
        "--period", type=float, metavar="SECONDS", help="time between rows of files without a time column"
    )
    add_means_argument(group, "auto")


def add_means_argument(parser: argparse._ActionsContainer, default: str | None) -> None:
    """Declare --current-means; None as its default where something else says it."""
    parser.add_argument(
        "--current-means",
        choices=CHOICES,
        default=default,
        help="currents are means over each row while voltages are instants, typical of loggers with one row per second "
        f"(default: {default or 'that of the profile, else auto'}; auto: from the data)",
    )


def read_recording(path: Path, args: argparse.Namespace) -> Recording:
    """Return the recording of a cell in a file, read as the arguments of `add_reading_arguments` say.

    Raises:
        DatasetError: see `app.sources.recordings.dataset.load_recording`.
    """
    from app.estimation.recording.current_means import takes_means, with_voltage_means
    from app.sources.recordings.dataset import load_recording, map_of, parse_map

    recording = load_recording(
        path, parse_map(map_of(args.map, path)), charge_positive=args.charge_positive, period_s=args.period
    )
    return with_voltage_means(recording) if takes_means(args.current_means, recording) else recording


def data_folder(args: argparse.Namespace) -> Path:
    """Return the data folder: the one chosen, else the service's."""
    from app.service.settings import Settings

    return getattr(args, "data", None) or Settings().data


def catalogue(args: argparse.Namespace) -> Catalogue:
    """Return the sessions of the data folder.

    Raises:
        ConfigError: a folder was chosen with --data and does not exist.
    """
    from app.sessions.catalogue import Catalogue

    folder = data_folder(args)
    if getattr(args, "data", None) is not None and not folder.exists():
        siblings = (
            [sibling.name for sibling in folder.parent.iterdir() if sibling.is_dir()] if folder.parent.is_dir() else []
        )
        meant = closest(folder.name, siblings)
        there = Message("no-such-folder-but", meant=str(folder.parent / meant)) if meant else Message("no-such-folder")
        raise ConfigError("--data", folder, there)
    return Catalogue(folder / "sessions")


def find_session(args: argparse.Namespace, session: str) -> Path:
    """Return the file of a session given by id or by path.

    Raises:
        SessionNotFound: neither is there.
    """
    path = Path(session)
    return path if path.is_file() else catalogue(args).path(session)


def chosen_battery(args: argparse.Namespace) -> tuple[Battery, CellModel]:
    """Return whose sessions are meant, with its cell.

    Raises:
        AppError: the battery or its cell file cannot be used.
    """
    from app.service.settings import Settings
    from app.sources.loaded_battery import load_battery

    settings = Settings()
    battery = load_battery(args.battery or settings.battery).battery
    return battery, chosen_cell(settings.cell or battery.cell)


def chosen_cell(name: str, field: str = "cell") -> CellModel:
    """Return the cell of a cell file, or the bundled one of this name.

    Raises:
        ConfigError: there is none, or it cannot be used.
    """
    from app.estimation.cell_model.cell_file import load_cell
    from app.estimation.errors import EstimatorError

    try:
        return load_cell(name)
    except EstimatorError as error:
        raise ConfigError(field, name, str(error)) from error


def existing(field: str, path: Path) -> Path:
    """Return a file that is there.

    Raises:
        ConfigError: there is none.
    """
    if not path.is_file():
        raise ConfigError(field, path, Message("no-such-file"))
    return path


def unix_s(field: str, text: str, allowed: Message | None = None) -> float:
    """Return a time of ISO 8601, in UTC where it does not say, as seconds since 1970.

    Raises:
        ConfigError: it is none.
    """
    try:
        time = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError(field, text, allowed or Message("time-iso")) from error
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


def write_out(text: str | bytes, out: Path | None) -> None:
    """Write to a file, or without one to standard output.

    Raises:
        ConfigError: the file cannot be written.
    """
    content = text.encode() if isinstance(text, str) else text
    if out is None:
        sys.stdout.write(content.decode())
        return
    try:
        out.write_bytes(content)
    except OSError as error:
        raise ConfigError("out", out, error.strerror or str(error)) from error
