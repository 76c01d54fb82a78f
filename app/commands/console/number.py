"""Numbers on a command line."""

import argparse
import re
from collections.abc import Callable

from app.battery.fields import MOST_CELLS


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


def segments(text: str) -> tuple[int, int]:
    """Read segments in series x cells in series in each, as `8x12`."""
    found = re.fullmatch(r"(\d{1,4})[xX](\d{1,4})", text)
    n, in_series = (int(part) for part in found.groups()) if found else (0, 0)
    if not 1 <= n * in_series <= MOST_CELLS:
        raise argparse.ArgumentTypeError(f"{text!r} is not SEGMENTSxCELLS, as 8x12, with 1 to {MOST_CELLS} cells")
    return n, in_series
