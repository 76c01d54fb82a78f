"""`voltwall firmware`: a cell file as a C header, for the estimator on the master's microcontroller."""

import argparse
from pathlib import Path

from app.commands.arguments import chosen_cell, write_out
from app.commands.console import between


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments: the cell, the resolution and the output."""
    parser.set_defaults(run=run)
    parser.add_argument("--cell", default="samsung-25r-10p", help="cell file or bundled cell (default: %(default)s)")
    parser.add_argument(
        "--soc-step",
        type=between(0.001, 0.05, "SOC"),
        default=0.005,
        metavar="SOC",
        help="SOC step of the tables (default: %(default)s); half the step needs twice the flash",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: standard output)")


def run(args: argparse.Namespace) -> int:
    """Write it.

    Raises:
        ConfigError: there is no such cell, or the file cannot be written.
    """
    from app.estimation.filters.c_tables import c_tables

    write_out(c_tables(chosen_cell(args.cell), args.soc_step), args.out)
    return 0
