"""The tables of docs/reference/accuracy.md are those of its command, row by row, and there are no others."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/reference/accuracy.md").read_text(encoding="utf-8")
MARK = re.compile(r"<!-- (\w+) -->\n")


def parts(text: str) -> dict[str, list[str]]:
    """Return the table lines behind each mark."""
    _, *found = MARK.split(text)
    return {
        name: [line for line in body.splitlines() if line.startswith("|")]
        for name, body in zip(found[::2], found[1::2], strict=True)
    }


@pytest.fixture(scope="module")
def expected() -> dict[str, list[str]]:
    command = [sys.executable, "-m", "benchmarks.accuracy", "--rows"]
    return parts(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=110).stdout)


def test_every_part_of_the_command_has_its_place_and_no_table_another(expected: dict[str, list[str]]) -> None:
    assert sorted(MARK.findall(PAGE)) == sorted(expected)
    assert len(expected) > 5
    outside = re.sub(r"<!-- (\w+) -->\n.*?<!-- end of \1 -->", "", PAGE, flags=re.DOTALL)
    assert [line for line in outside.splitlines() if line.startswith(("|", "<!--"))] == []


def test_the_tables_have_the_head_and_the_rows_of_the_command(expected: dict[str, list[str]]) -> None:
    page = parts(PAGE)
    for name, (head, rule, *begins) in expected.items():
        assert page[name][:2] == [head, rule], name
        rows = page[name][2:]
        if begins:  # those that are known before they are measured
            wrong = [row for row, begin in zip(rows, begins, strict=True) if not row.startswith(begin)]
            assert wrong == [], f"python -m benchmarks.accuracy {name} --write"
        assert rows, name
        assert {row.count("|") for row in rows} == {head.count("|")}, name
