"""The example files of the documentation are ones that the program takes."""

from pathlib import Path

import pytest

from app.analysis.expectations import Expectations
from app.sources.loaded_battery import team_battery

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.expect.toml")), ids=lambda path: path.name)
def test_expectations_are_read(path: Path) -> None:
    assert Expectations(path.read_text(encoding="utf-8"), team_battery().battery).verdicts()
