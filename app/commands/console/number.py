"""Numbers on a command line."""

import argparse
from collections.abc import Callable


def between(low: float, high: float, meaning: str) -> Callable[[str], float]:
    """Return argparse's converter for a number within limits; the refusal names them and what is counted."""

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not {low:g} to {high:g} {meaning}")
        return value

    return convert
