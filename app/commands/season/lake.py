"""Which lake an action of `voltwall season` works on."""

import argparse

from app.commands.session_commands.selection import data_folder
from app.service.settings import Settings


def lake_of(args: argparse.Namespace) -> str:
    """Return where the lake lies."""
    return str(args.lake or Settings.model_validate({}).lake or data_folder(args) / "lake")
