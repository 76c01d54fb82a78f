"""`voltwall identify`: fit a cell model to measurements, write it as a cell file, say how well it fits."""

import argparse
from pathlib import Path

from app.commands.arguments.common import add_reading_arguments
from app.commands.arguments.work import Work


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.set_defaults(do=Work("cell_commands.identify.run"))
    parser.description = (
        "Fit OCV, resistances and time constants of a cell to slow tests, pulse tests and, better, a drive."
    )
    parser.add_argument(
        "--ocv", nargs="+", required=True, type=Path, metavar="FILE", help="slow discharge and charge, C/10 or less"
    )
    parser.add_argument(
        "--pulses", nargs="+", default=[], type=Path, metavar="FILE", help="pulse tests, at one or more temperatures"
    )
    parser.add_argument(
        "--drive", nargs="+", default=[], type=Path, metavar="FILE", help="drives with the currents of a race"
    )
    parser.add_argument("--rc", type=int, default=2, choices=range(5), metavar="N", help="RC pairs, 0..4 (default 2)")
    parser.add_argument("--out", required=True, type=Path, metavar="CELL.toml", help="the cell file to write")
    parser.add_argument("--name", help="name of the cell; left out: that of the cell file")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw OCV, resistances and the residual of each file")
    add_reading_arguments(parser)
