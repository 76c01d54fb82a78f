"""`voltwall battery`: profiles of batteries that are not the team's own."""

import argparse

from app.commands.battery import check, learn, show, size


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for module in (show, check, learn, size):
        module.add_actions(actions)


def run(args: argparse.Namespace) -> int:
    """Do what was asked for.

    Raises:
        AppError: a profile, a DBC or a log cannot be read, or is wrong.
    """
    return int(args.do(args))
