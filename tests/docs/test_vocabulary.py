"""Names, comments and texts in the words of the field: banned words, exceptions, areas that still have some."""

import ast
import io
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# In names, comments and docstrings. A part of a name counts: `told_v`, `HeardOnCan`.
WORDS = frozenset(
    [
        "told",
        "heard",
        "hear",
        "hears",
        "said",
        "speaks",
        "beside",
        "witness",
        "believe",
        "believed",
        "doubt",
        "doubts",
        "feel",
        "keeper",
        "suspicion",
        "hindrance",
        "lesson",
        "telling",
        "mend",
        "mended",
        "make_believe",
    ]
)
NAME_PARTS = WORDS | {"look", "looks"}  # "to look for a file" is plain English, a `look` is a sample, a check or a poll
BARE_NAMES = frozenset({"each", "found", "known"})
# In texts and documents: rules 2 to 5 of the language review.
PHRASES = (
    r"\bheard\b", r"\bhears\b", r"\bspeaks\b", r"\bbeside\b", r"\banew\b", r"\bfor ever\b", r"\bin force\b",
    r"\bin all\b(?! (?:cells|laps|sessions))", r"\bof (?:then|now|before)\b", r"\btold\b", r"\btells?\b",
    r"\bby itself\b", r"\bfor good\b", r"\bso (?:many|much|often|long)\b", r"\bwhoever\b", r"\b(?:some|every)body\b",
    r"\bgo(?:es)? on\b", r"\bbeforehand\b", r"\blikewise\b", r"\brelays\b",
)  # fmt: skip
EXCEPTIONS = {
    ("app/analysis/expectations.py", "found"): "key of the answer of `replay --expect --json`",
    ("app/api/configuration/slave_check.py", "found"): "argument of the message `slave-checked`, which sessions hold",
    ("app/battery/profile.py", "witness"): "names the table `[[witness]]` of old profiles, which is refused",
}
PHRASE_EXCEPTIONS = {
    ("simulator.md", "relays"): "the field of the control port's answer",
    ("firmware.md", "relays"): "the members of the C library's struct",
}
NOT_TEXT = re.compile(r"^  \"[^\"]*\": |\btest_\w+")  # the code of a text, and the name of a test
SUFFIXES = (".py", ".c", ".h", ".ts", ".svelte")
AREAS = ("app", "benchmarks", "firmware_protocol", "frontend/src", "simulator", "voltwall", ".ci")


def is_left(path: str, areas) -> bool:
    return any(path == area or path.startswith(f"{area}/") for area in areas)


def files(*suffixes: str):
    for area in AREAS:
        for path in sorted((ROOT / area).rglob("*")):
            name = path.relative_to(ROOT).as_posix()
            if path.suffix in suffixes and "__pycache__" not in name and "/static/" not in name:
                yield name, path


def parts(text: str) -> set[str]:
    return {part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", text)}


@cache
def names_and_comments(path: Path) -> tuple[tuple[int, str, str], ...]:
    """Every name, comment and docstring of a Python file: line, kind, text."""
    text, found, statement = path.read_text(encoding="utf-8"), [], True
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NAME:
            found.append((token.start[0], "name", token.string))
        elif token.type == tokenize.COMMENT:
            found.append((token.start[0], "comment", token.string))
        elif token.type == tokenize.STRING and statement and '"""' in token.string[:4]:
            lines = enumerate(token.string.splitlines(), token.start[0])
            found += [(line, "comment", re.sub(r"`[^`]*`", "", part)) for line, part in lines]
        if token.type not in (tokenize.COMMENT, tokenize.NL):
            statement = token.type in (tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENCODING)
    return tuple(found)


def banned(name: str, path: Path):
    if path.suffix == ".py":
        for line, kind, text in names_and_comments(path):
            for word in sorted(parts(text) & (NAME_PARTS if kind == "name" else WORDS)):
                yield line, word
    else:
        for line, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            for word in sorted(parts(text) & WORDS):
                yield line, word


@pytest.mark.parametrize("area", AREAS)
def test_names_and_comments_have_no_banned_word(area):
    found = [
        f"{name}:{line}: {word}"
        for name, path in files(*SUFFIXES)
        if is_left(name, (area,))
        for line, word in banned(name, path)
        if (name, word) not in EXCEPTIONS
    ]
    assert found == []


def test_no_variable_is_named_by_a_bare_word():
    bare = [
        f"{name}:{line}: {text}"
        for name, path in files(".py")
        for line, kind, text in names_and_comments(path)
        if kind == "name" and text in BARE_NAMES and (name, text) not in EXCEPTIONS
    ]
    assert bare == []


def test_no_comment_is_a_fragment_of_the_name_before_it():
    found = [
        f"{name}:{line}"
        for name, path in files(".py")
        for line, kind, text in names_and_comments(path)
        if kind == "comment" and re.match(r"# ?of ", text)
    ]
    assert found == []


def docstrings(text: str):
    """Public docstrings of a Python file: line and first line."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            is_private = re.match("_[^_]", getattr(node, "name", ""))
            if not is_private and (lines := (ast.get_docstring(node) or "").splitlines()):
                yield node.body[0].lineno, lines[0]


def test_a_docstring_begins_with_what_a_thing_is_or_does():
    clauses = [
        f"{name}:{line}: {first}"
        for name, path in files(".py")
        for line, first in docstrings(path.read_text(encoding="utf-8"))
        if re.match(r"(?:What|Whether|Where|When|Who|Whose|How|Which|Why)\b", first)
    ]
    assert clauses == []


def test_every_exception_is_still_needed():
    for name, word in EXCEPTIONS:
        assert word in (ROOT / name).read_text(encoding="utf-8"), f"{name}: {word} is gone"
    for name, word in PHRASE_EXCEPTIONS:
        assert any(word in path.read_text(encoding="utf-8") for path in documents() if path.name == name), (
            f"{name}: {word} is gone"
        )


def documents():
    """Documents and tables of texts; the generated command line reference repeats texts of the code."""
    yield from (ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md"))
    yield from sorted((ROOT / "docs").rglob("*.md"))
    yield from sorted((ROOT / "app" / "words" / "en").rglob("*.json"))


def is_excepted(name: str, word: str, text: str) -> bool:
    return (name, word) in PHRASE_EXCEPTIONS or "Withdrawn" in text  # a withdrawn name is quoted as it was


def test_texts_and_documents_have_no_banned_phrase():
    found = [
        f"{path.relative_to(ROOT).as_posix()}:{line}: {match[0]}"
        for path in documents()
        for line, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        for match in re.finditer("|".join(PHRASES), NOT_TEXT.sub("", text))
        if not is_excepted(path.name, match[0], text)
    ]
    assert found == []
