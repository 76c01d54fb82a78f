"""Arguments that several commands have."""

import argparse
from pathlib import Path

from app.commands.arguments.work import Work


def add_data_argument(parser: argparse.ArgumentParser, default: object = None) -> None:
    """Declare --data; below another parser that has it, with argparse.SUPPRESS as its default."""
    parser.add_argument("--data", type=Path, metavar="DIR", default=default, help="data folder of the service")


def new_action(
    actions: "argparse._SubParsersAction[argparse.ArgumentParser]", name: str, text: str, do: str
) -> argparse.ArgumentParser:
    """Return the parser of one more action, with --data, that does the work of this name."""
    parser = actions.add_parser(
        name, help=text, description=text[0].upper() + text[1:] + ".", formatter_class=argparse.RawTextHelpFormatter
    )
    add_data_argument(parser, argparse.SUPPRESS)
    parser.set_defaults(do=Work(do))
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


def add_trust_argument(parser: argparse.ArgumentParser) -> None:
    """Whose certificate is believed."""
    parser.add_argument(
        "--trust",
        metavar="FILE|FINGERPRINT",
        help="certificate of an https service: a PEM file, or its SHA-256 (default: VOLTWALL_TRUST, else the system's)",
    )


def add_reading_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare how columns, signs and a missing clock of the user's files are to be read."""
    group = parser.add_argument_group("reading the files")
    group.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="FIELD=COLUMN[*FACTOR],...",
        help="which column is what, by header text or number from 1; fields: time_s, current_a, voltage_v, "
        "temperature_c, soc",
    )
    group.add_argument("--charge-positive", action="store_true", help="the files count charging current as positive")
    group.add_argument("--period", type=float, metavar="SECONDS", help="time between rows, for files without a clock")
