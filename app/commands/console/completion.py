"""`voltwall completion`: what a shell runs at its start to complete our commands and options."""

import argparse
from importlib import import_module

from app.errors import ExtraMissing


def run(args: argparse.Namespace) -> int:
    """Print the code of a shell.

    Raises:
        ExtraMissing: argcomplete is not installed.
    """
    try:
        argcomplete = import_module("argcomplete")
    except ImportError as error:
        raise ExtraMissing("completion", "argcomplete", "completion") from error
    print(argcomplete.shellcode(["voltwall"], shell=args.shell), end="")
    return 0
