"""`voltwall simulate`: the simulated accumulator, or with `--battery` any other."""

import argparse

from app.commands.arguments.work import Work
from simulator.arguments import add_arguments as add_simulator_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The simulator's own, and the battery."""
    parser.set_defaults(do=Work("simulator.simulate.run"))
    add_simulator_arguments(parser)
    parser.add_argument(
        "--battery",
        metavar="NAME|FILE",
        help="a battery by its profile, or packs x cells in each as 2x6, on CAN by its DBC (default: the team's own)",
    )
