"""`voltwall dbc`: the CAN tables of a configuration as a DBC file."""

import argparse
from pathlib import Path

from app.commands.arguments.work import Work


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Where from, where to."""
    parser.set_defaults(do=Work("dbc.run"))
    parser.add_argument(
        "--image", type=Path, metavar="FILE", help="a 420-byte configuration image (default: the default tables)"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="where to write (default: standard output)")
