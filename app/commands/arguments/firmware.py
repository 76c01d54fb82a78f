"""`voltwall firmware`: a cell file as a C header, for the estimator on the master's microcontroller."""

import argparse
from pathlib import Path

from app.commands.arguments.work import Work
from app.commands.console.number import between


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which cell, how fine, where to."""
    parser.set_defaults(do=Work("firmware.run"))
    parser.add_argument("--cell", default="samsung-25r-10p", help="cell file or name (default: %(default)s)")
    parser.add_argument(
        "--soc-step",
        type=between(0.001, 0.05, "SOC"),
        default=0.005,
        metavar="SOC",
        help="distance of the tables' points (default: %(default)s); half of it takes twice the flash",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="where to write (default: standard output)")
