"""Which lake an action of `voltwall season` works on."""

import argparse

from app.commands.session_commands.selection import data_folder
from app.service.settings import Settings


def add_lake_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --lake."""
    parser.add_argument(
        "--lake", metavar="DIR|URL", help="the lake: a folder, or a URL of fsspec (default: lake in the data folder)"
    )


def lake_of(args: argparse.Namespace) -> str:
    """Return where the lake lies."""
    return str(args.lake or Settings.model_validate({}).lake or data_folder(args) / "lake")
