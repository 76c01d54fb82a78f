"""`voltwall season`: what many sessions say together."""

import argparse

from app.commands.season import build, estimate, match, query, report, simulate
from app.commands.session_commands.selection import add_data_argument


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    add_data_argument(parser)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for module in (build, query, report, estimate, match, simulate):
        module.add_actions(actions)


def run(args: argparse.Namespace) -> int:
    """Do what was asked for.

    Raises:
        AppError: a folder, a file or a question cannot be read, or is wrong.
    """
    return int(args.do(args))
