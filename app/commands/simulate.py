"""`voltwall simulate`: hands over to the simulator."""

import argparse

from simulator.cli import add_arguments as add_simulator_arguments
from simulator.cli import run as run_simulator


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The simulator's own."""
    add_simulator_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run it in this process."""
    return run_simulator(args)
