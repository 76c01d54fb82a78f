"""Every command line of `voltwall` in README and documentation is one that the program takes, with real options."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.cli import build_parser

ROOT = Path(__file__).parents[2]
GENERATED = {"cli.md"}  # from the parser itself
PAGES = [ROOT / "README.md", *sorted(p for p in (ROOT / "docs").rglob("*.md") if p.name not in GENERATED)]
_BLOCK = re.compile(r"^ *```(?:sh|bash|console|text|powershell)?\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
_IN_LINE = re.compile(r"`([^`\n]+)`")
_BEGIN = re.compile(r"^(?:[$>] |PS> )?(?:[A-Z_]+=\S+ )*(?:sudo )?(?:[\w./\\]*[/\\])?voltwall(?:\.exe)? (.+)$")


def command_lines(text: str) -> Iterator[tuple[str, bool]]:
    """Yield what follows `voltwall` on lines of a page's blocks, True, and in its inline code, False."""
    blocks = [block.replace("\\\n", " ") for block in _BLOCK.findall(text)]
    lines = [(line.strip(), True) for block in blocks for line in block.splitlines()]
    inline = [(line, False) for line in _IN_LINE.findall(_BLOCK.sub("", text))]
    for line, is_whole in [*lines, *inline]:
        if found := _BEGIN.match(line):
            yield found[1], is_whole


def words_of(line: str) -> list[str]:
    """Split as a shell does, up to what is no longer ours."""
    words = shlex.split(line, comments=True)
    ends = [k for k, word in enumerate(words) if word in ("|", ">", "&&", "&", ";", "2>", ">>")]
    return words[: ends[0]] if ends else words


LINES = [(page, *line) for page in PAGES for line in command_lines(page.read_text(encoding="utf-8"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_command_line_is_understood(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = [why for where, line, is_whole in LINES if where == page and (why := refused(line, is_whole, capsys))]
    assert wrong == []


def refused(line: str, is_whole: bool, capsys: pytest.CaptureFixture[str]) -> str | None:
    """Return why the parser refuses a line; in a sentence, and before `...`, arguments may be left out."""
    words = words_of(re.sub(r"[\[\]](?=[\s-]|$)", " ", line))  # [--what may be left out]
    if "..." in line:
        is_whole, words = False, words[: next(k for k, word in enumerate(words) if "..." in word)]
    if not words or words[0].startswith("-"):
        return None
    try:
        build_parser(words[0]).parse_args(words)
    except SystemExit as ended:
        said = capsys.readouterr().err.strip().rpartition("\n")[2]
        is_short = not is_whole and any(text in said for text in ("arguments are required", "expected one argument"))
        return None if ended.code == 0 or is_short else f"voltwall {line}: {said}"
    return None


def test_many_lines_are_looked_at() -> None:
    assert len(LINES) > 100
    assert sum(is_whole for _, _, is_whole in LINES) > 40
