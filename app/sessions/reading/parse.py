"""Parsing of a text in a session: here, or by the service in a process with limits."""

from collections.abc import Callable
from typing import Protocol, TypeVar

A = TypeVar("A")
T = TypeVar("T")


class Parse(Protocol):
    """Returns what a function of a module makes of a text, or raises what it raises."""

    def __call__(self, function: Callable[[A], T], text: A) -> T:
        """Parse a text, or files by their names."""


def in_process(function: Callable[[A], T], text: A) -> T:
    """Parse it here: of the command line, and within a worker."""
    return function(text)
