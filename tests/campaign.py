"""Some tests have three sizes: a sample in `make test`, more in `make campaign SHORT=1`, all in `make campaign`.

`.ci/campaign.py` runs the larger two: VOLTWALL_CAMPAIGN names the size, VOLTWALL_FIGURES the file of what they found.
"""

import os
from pathlib import Path

import pytest

SIZES = ("sample", "short", "full")
SIZE = os.environ.get("VOLTWALL_CAMPAIGN", "sample")


def of_size(sample: float, short: float, full: float) -> int:
    """Return how many, in this run."""
    return int((sample, short, full)[SIZES.index(SIZE)])


def examples(many: int) -> int:
    """Return how many examples a property is tried with: an eighth in `make test`, five times in the full campaign.

    The short campaign, which is part of every CI run, tries half of them.
    """
    return of_size(max(many // 8, 1), max(many // 2, 1), 5 * many)


def campaign(sample_s: float, short_s: float, full_s: float) -> pytest.MarkDecorator:
    """Mark a test that has sizes, with what each may take at most [s]."""
    return pytest.mark.timeout(of_size(sample_s, short_s, full_s))


def tell_figure(figure: str) -> None:
    """Keep what a test found for the end of the campaign, with the test's name."""
    if path := os.environ.get("VOLTWALL_FIGURES"):
        test = os.environ.get("PYTEST_CURRENT_TEST", "").partition(" ")[0]
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(f"{test}\t{figure}\n")
