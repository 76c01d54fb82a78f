"""`voltwall simulate`: hands over to the simulator."""

import argparse

from simulator import cli


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The simulator's own."""
    cli.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run it in this process."""
    return cli.run(args)
