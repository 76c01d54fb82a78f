"""Numbers on a command line."""

import argparse
import re
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


def segments(text: str) -> tuple[int, int]:
    """Read segments in series x cells in series in each, as `8x12`."""
    from app.battery.fields import MOST_CELLS  # here: numpy comes with it

    found = re.fullmatch(r"(\d{1,4})[xX](\d{1,4})", text)
    n, in_series = (int(part) for part in found.groups()) if found else (0, 0)
    if not 1 <= n * in_series <= MOST_CELLS:
        raise argparse.ArgumentTypeError(f"{text!r} is not SEGMENTSxCELLS, as 8x12, with 1 to {MOST_CELLS} cells")
    return n, in_series


def percent(text: str) -> float:
    """Read 0 to 100, with or without its sign."""
    try:
        value = float(text.removesuffix("%"))
    except ValueError:
        value = float("nan")
    if not 0.0 <= value <= 100.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not 0 to 100 percent")
    return value


def fraction(text: str) -> float:
    """Read 0 to 1, or per cent with their sign."""
    try:
        value = float(text.rstrip("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 1; write percent with a % sign")
    return value
