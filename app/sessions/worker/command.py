"""A command of the program, run in a worker: what it prints comes back, as it would from a process of its own."""

import contextlib
import importlib
import io
from collections.abc import Sequence

from app.errors import AppError
from app.sessions.worker.child_process import our_module


class CommandRefused(AppError):
    """The command ended with an error: the last line of its own words."""


def output_of(arguments: Sequence[str]) -> str:
    """Return what `voltwall ARGUMENTS` prints.

    Raises:
        CommandRefused: it ended with another code than 0.
    """
    printed, told = io.StringIO(), io.StringIO()
    program = importlib.import_module(our_module("app.cli"))  # by name, as it finds its commands: nobody here knows one
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(told):
            code = program.main(arguments)
    except SystemExit as ended:  # argparse
        code = ended.code
    if code:
        raise CommandRefused((told.getvalue().strip().splitlines() or [f"exit code {code}"])[-1])
    return printed.getvalue()
