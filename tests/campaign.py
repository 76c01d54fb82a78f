"""Some tests have sizes: a sample in `make test`, more in `make campaign SHORT=1`, still more in `make campaign`.

The longest, hours, is `make campaign LONG=1`; most tests have no size of their own for it. `.ci/campaign.py` runs all
but the first: VOLTWALL_CAMPAIGN names the size, VOLTWALL_FIGURES the file of what they found. The short one is part of
every CI run; the full one ends within 30 minutes on two quiet cores, so what is added there is taken off elsewhere.
"""

import os
from pathlib import Path

import pytest

SIZES = ("sample", "short", "full", "long")
SIZE = os.environ.get("VOLTWALL_CAMPAIGN", "sample")
IS_FULL = SIZE in ("full", "long")


def of_size(sample: float, short: float, full: float, long: float | None = None) -> int:
    """Return how many, in this run; in the longest as in the full one, if it has no size of its own."""
    return int((sample, short, full, full if long is None else long)[SIZES.index(SIZE)])


def examples(many: int) -> int:
    """Return how many examples a property is tried with: an eighth in `make test`, all in the full campaign.

    The long campaign tries five times as many; the short one has few properties, and half of their examples.
    """
    return of_size(max(many // 8, 1), max(many // 2, 1), many, 5 * many)


def campaign(sample_s: float, short_s: float, full_s: float) -> pytest.MarkDecorator:
    """Mark a test that has sizes, with what each may take at most [s]."""
    return pytest.mark.timeout(of_size(sample_s, short_s, full_s))


def report_figure(figure: str) -> None:
    """Keep what a test found for the end of the campaign, with the test's name."""
    if path := os.environ.get("VOLTWALL_FIGURES"):
        test = os.environ.get("PYTEST_CURRENT_TEST", "").partition(" ")[0]
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(f"{test}\t{figure}\n")
