"""What the hand-written documents promise is there: commands, flags, targets, links."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.cli import COMMANDS, build_parser

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("firmware_protocol/*.md")])
README = (ROOT / "README.md").read_text(encoding="utf-8")
FENCED = re.compile(r"^```[a-z]*\n(.*?)^```", re.MULTILINE | re.DOTALL)


def command_lines(program: str) -> Iterator[tuple[str, list[str]]]:
    """Each line of a code block in which `program` is run: (document, words after the program)."""
    for document in DOCUMENTS:
        for block in FENCED.findall(document.read_text(encoding="utf-8")):
            for line in block.replace("\\\n", " ").splitlines():
                words = line.replace('"', " ").split()
                starts = [i for i, word in enumerate(words) if re.split(r"[/\\]", word)[-1] == program]
                if starts and starts[0] == len([word for word in words[: starts[0]] if "=" in word]):
                    yield document.name, words[starts[0] + 1 :]


def long_flags(command: str) -> set[str]:
    with_help = build_parser(command)
    subparsers = next(action for action in with_help._actions if isinstance(action.choices, dict))
    todo = [subparsers.choices[command]]
    flags = set()
    while todo:
        parser = todo.pop()
        for action in parser._actions:
            flags.update(action.option_strings)
            if isinstance(action.choices, dict):
                todo.extend(action.choices.values())
    return flags


def test_readme_and_documents_stay_short() -> None:
    assert len(README.split()) <= 600
    for release in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1:]:
        assert len(release.split()) <= 600, release.splitlines()[0]
    pages = [page for page in (ROOT / "docs").rglob("*.md") if page.name != "cli.md"]
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in pages) <= 45_000


def test_readme_begins_with_the_two_commands() -> None:
    assert [block.strip() for block in FENCED.findall(README)[:2]] == ["make run", "make test"]


def test_readme_names_every_command_of_the_program() -> None:
    assert [name for name in COMMANDS if f"`voltwall {name}`" not in README] == []


def test_every_make_target_in_a_document_exists() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    named = {(name, words[0]) for name, words in command_lines("make") if words}
    assert {target for _, target in named} >= {"run", "test"}
    assert [item for item in named if item[1] not in targets] == []


def test_every_voltwall_command_line_in_a_document_parses() -> None:
    lines = list(command_lines("voltwall"))
    lines += [
        (name, ["serve", *line.split("ARGS=", 1)[1].split()])
        for name, words in command_lines("make")
        if words[:1] == ["run"] and "ARGS=" in (line := " ".join(words))
    ]
    assert len(lines) > 5
    wrong = []
    for name, words in lines:
        if words[0].startswith("-"):
            continue
        flags = {word.split("=")[0] for word in words if word.startswith("--")} - {"--help"}
        if words[0] not in COMMANDS or not flags <= long_flags(words[0]):
            wrong.append((name, " ".join(words)))
    assert wrong == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_relative_link_leads_somewhere(document: Path) -> None:
    text = FENCED.sub("", document.read_text(encoding="utf-8"))
    targets = [target.split("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target]
    assert [target for target in targets if target and not (document.parent / target).exists()] == []


def test_every_guide_and_reference_page_is_reachable_from_the_index() -> None:
    seen: set[Path] = set()
    todo = [ROOT / "docs" / "index.md"]
    while todo:
        page = todo.pop()
        seen.add(page)
        for target in re.findall(r"\]\(([^)\s#]+\.md)", page.read_text(encoding="utf-8")):
            linked = (page.parent / target).resolve()
            if linked.exists() and linked not in seen:
                todo.append(linked)
    assert [str(page.relative_to(ROOT)) for page in DOCUMENTS if page.parent != ROOT and page not in seen] == []
