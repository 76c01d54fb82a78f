"""`voltwall bench`: this machine's figures, with the method beside each."""

import argparse

from app.commands.arguments.work import Work
from app.commands.console.number import between


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What to measure and for how long."""
    parser.set_defaults(do=Work("bench.run"))
    parser.add_argument(
        "--seconds",
        type=between(1.0, 86400.0, "s"),
        default=30.0,
        help="of each run of the service (default: 30)",
    )
    parser.add_argument("--cell", default="samsung-25r-10p", help="cell file or name (default: %(default)s)")
    parser.add_argument("--predictions", action="store_true", help="how often bands held the truth (from a checkout)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
