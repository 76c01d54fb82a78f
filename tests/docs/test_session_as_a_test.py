"""The page on sessions as tests names every value that an expectation may be about."""

import re
from pathlib import Path

from app.analysis.expectations import PER_CELL, TOTALS

PAGE = Path(__file__).resolve().parents[2] / "docs/howto/session-as-a-test.md"


def test_the_names_of_values_are_those_of_the_snapshot():
    (line,) = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("Names of values:")]
    named = re.findall(r"`([a-z_]+)(\[3/7\])?`", line)
    assert [name for name, cell in named if not cell] == list(TOTALS)
    assert [name for name, cell in named if cell] == list(PER_CELL)
