"""`voltwall estimate`: run a filter over a recording of one cell and, where the SOC is known, score it."""

import argparse
from pathlib import Path

from app.commands.arguments.common import add_reading_arguments
from app.commands.arguments.work import Work
from app.commands.console.number import fraction
from app.estimation.filters.filter_names import FILTERS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.set_defaults(do=Work("cell_commands.estimate.run"))
    parser.description = "Estimate the state of charge along a recording; score it where the file has a soc column."
    parser.add_argument("file", type=Path, metavar="FILE", help="recording: CSV or Parquet, plain or gzip")
    parser.add_argument("--cell", required=True, metavar="CELL.toml", help="cell file, or the name of a bundled cell")
    parser.add_argument("--filter", choices=FILTERS, default="fused", help="default: %(default)s")
    parser.add_argument(
        "--initial-soc",
        type=fraction,
        metavar="S",
        help="SOC believed at the first row, 0..1 or with %%; left out: read off the first voltage",
    )
    parser.add_argument(
        "--initial-sigma", type=fraction, metavar="S", help="how far that may be off (1 sigma); left out: the filter's"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the estimates: .csv, .csv.gz or .parquet")
    parser.add_argument(
        "--power",
        action="store_true",
        help="state of power for 1, 10 and 30 s [W] with a band of 90 %%: columns in --out, a summary in text and JSON",
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw SOC with 3 sigma, voltage and residual")
    add_reading_arguments(parser)
