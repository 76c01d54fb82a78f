"""The work of a command, imported when it runs: whoever asks for --help or presses Tab does not wait for it."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import cast

Run = Callable[[argparse.Namespace], int]


@dataclass(frozen=True, slots=True)
class Work:
    """A function below `app.commands`, by its full name, as `season.build.build`."""

    name: str

    def function(self) -> Run:
        """Import its module and return it."""
        module, _, function = self.name.rpartition(".")
        return cast(Run, getattr(import_module(f"..{module}", __package__), function))

    def __call__(self, args: argparse.Namespace) -> int:
        """Do it; return the exit code."""
        return int(self.function()(args))
