"""docs/contributing/asvs.md has every requirement of the standard's levels 1 and 2 once, and names tests that exist."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "contributing" / "asvs.md").read_text(encoding="utf-8")
STATES = ("met", "partly", "not done", "n.a.")

# The numbers of levels 1 and 2 in ASVS 4.0.3: section -> the last part of each, removed and level 3 ones left out.
NUMBERS = """
1.1: 1-7; 1.2: 1-4; 1.4: 1 4 5; 1.5: 1-4; 1.6: 1-4; 1.7: 1 2; 1.8: 1 2; 1.9: 1 2; 1.10: 1; 1.11: 1 2; 1.12: 2;
1.14: 1-6; 2.1: 1-12; 2.2: 1-4; 2.3: 1-3; 2.4: 1-5; 2.5: 1-7; 2.6: 1-3; 2.7: 1-6; 2.8: 1-7; 2.9: 1-3; 2.10: 1-4;
3.1: 1; 3.2: 1-4; 3.3: 1-4; 3.4: 1-5; 3.5: 1-3; 3.7: 1; 4.1: 1 2 3 5; 4.2: 1 2; 4.3: 1-3; 5.1: 1-5; 5.2: 1-8;
5.3: 1-10; 5.4: 1-3; 5.5: 1-4; 6.1: 1-3; 6.2: 1-6; 6.3: 1 2; 6.4: 1 2; 7.1: 1-4; 7.2: 1 2; 7.3: 1 3 4; 7.4: 1-3;
8.1: 1-4; 8.2: 1-3; 8.3: 1-8; 9.1: 1-3; 9.2: 1-4; 10.2: 1 2; 10.3: 1-3; 11.1: 1-8; 12.1: 1-3; 12.2: 1; 12.3: 1-6;
12.4: 1 2; 12.5: 1 2; 12.6: 1; 13.1: 1 3 4 5; 13.2: 1 2 3 5 6; 13.3: 1 2; 13.4: 1 2; 14.1: 1-4; 14.2: 1-6;
14.3: 2 3; 14.4: 1-7; 14.5: 1-4
"""


def expand(section: str, words: list[str]) -> list[str]:
    """Return `1-3`, `5` of a section as its numbers."""
    numbers = []
    for word in words:
        first, _, last = word.partition("-")
        numbers += [f"{section}.{n}" for n in range(int(first), int(last or first) + 1)]
    return numbers


def standard() -> list[str]:
    parts = (part.partition(": ") for part in re.split(r";\s*", NUMBERS.strip()))
    return [number for section, _, numbers in parts for number in expand(section, numbers.split())]


def rows() -> list[tuple[list[str], str, str]]:
    """Return numbers, state and notes of each row; a row has `5.1.1-4, 13.2.2`."""
    found = []
    for line in PAGE.splitlines():
        if re.match(r"\| \d+\.\d+\.\d+", line):
            items, state, notes = (cell.strip(" |") for cell in line.split(" | "))
            parts = (item.rpartition(".") for item in items.split(", "))
            found.append(([n for section, _, numbers in parts for n in expand(section, [numbers])], state, notes))
    return found


def test_every_requirement_is_listed_once() -> None:
    listed = [number for numbers, _, _ in rows() for number in numbers]
    assert sorted(listed) == sorted(standard())


def test_every_row_has_a_state_and_a_note() -> None:
    assert [row for row in rows() if row[1] not in STATES or not row[2]] == []


def functions(file: Path) -> set[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`(tests/[\w/]+\.py(?:::\w+)?)`", PAGE))))
def test_named_tests_exist(name: str) -> None:
    file, _, function = name.partition("::")
    assert (ROOT / file).is_file()
    assert not function or function in functions(ROOT / file)


def test_what_is_met_by_code_names_its_test() -> None:
    untested = [numbers for numbers, state, how in rows() if state == "met" and "tests/" not in how]
    assert untested == [["1.10.1"], ["2.1.11"]]  # git, and a plain password field
