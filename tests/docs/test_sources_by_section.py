"""docs/explanation/sources-by-section.md: every file, command, page and test that its tables name is there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/explanation/sources-by-section.md").read_text(encoding="utf-8")
COMMANDS = (ROOT / "docs/reference/cli.md").read_text(encoding="utf-8")  # made of the parser; tests/docs holds it
PAGES = (ROOT / "docs/reference/pages.md").read_text(encoding="utf-8")
CODE = re.compile(r"`([^`]+)`")


def is_command(words: list[str]) -> bool:
    """Whether `voltwall` has this command and each of the options that stand behind it."""
    name = " ".join(word for word in words if not word.startswith("--"))
    section = re.search(rf"^##+ {name}\n(.*?)(?=^##+ |\Z)", COMMANDS, re.MULTILINE | re.DOTALL)
    options = [word for word in words if word.startswith("--")]
    return section is not None and all(f"`{option}" in section.group(1) for option in options)


def is_module(words: list[str]) -> bool:
    """Whether `python -m` finds this module, and its text has each of the options that stand behind it."""
    file = ROOT / (words[2].replace(".", "/") + ".py")
    return file.is_file() and all(f'"{option}"' in file.read_text(encoding="utf-8") for option in words[3:])


def is_product(named: str) -> bool:
    words = named.split()
    if words[0] == "voltwall":
        return is_command(words)
    if words[:2] == ["python", "-m"]:
        return is_module(words)
    return (ROOT / named).is_file()


def is_test(named: str) -> bool:
    file, _, function = named.partition("::")
    path = ROOT / "tests" / file
    return path.is_file() and (not function or f"def {function}(" in path.read_text(encoding="utf-8"))


def rows() -> list[list[str]]:
    lines = [
        line for line in PAGE.splitlines() if line.startswith("| ") and not line.startswith(("| section", "| ---"))
    ]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_what_a_row_names_is_there(row: list[str]) -> None:
    assert len(row) == 4
    assert [named for named in CODE.findall(row[2]) if "/" in named or " " in named if not is_product(named)] == []
    assert [named for named in CODE.findall(row[3]) if not is_test(named)] == []
    pages = [page for page in re.findall(r"(?<!\*)\*(\w+)\*(?!\*)", row[2]) if f"| {page} |" not in PAGES]
    assert pages == []


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_what_has_nothing_to_show_says_that_it_is_not_there(row: list[str]) -> None:
    assert row[3] or row[2].startswith("**not there**")


def test_five_documents_have_a_table_each() -> None:
    assert PAGE.count("| section | what it says | where it is here | test or figure |") == PAGE.count("\n## ") == 5


@pytest.mark.parametrize(
    "named", ["app/not_there.py", "voltwall none", "voltwall balance --none", "python -m benchmarks.none"]
)
def test_what_is_not_there_is_noticed(named: str) -> None:
    assert not is_product(named)
    assert not is_test("docs/test_sources_redone.py::test_none")
