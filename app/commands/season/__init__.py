"""`voltwall season`: what many sessions say together."""

import argparse

from app.commands.season import estimate


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for module in (estimate,):
        module.add_actions(actions)


def run(args: argparse.Namespace) -> int:
    """Do what was asked for.

    Raises:
        AppError: a folder or a file cannot be read, or is wrong.
    """
    return int(args.do(args))
