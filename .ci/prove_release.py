"""Proves that a tag may become a release, and prints its section of the changelog: `prove_release.py v1.0.0`.

Tag, `__version__`, CHANGELOG.md and CITATION.cff have to name one version, the changelog its day, and pyproject.toml
the address of the repository.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VERSION = re.compile(r'(?m)^__version__ = "(.+)"$')
CITED = re.compile(r"(?m)^version: (.+)$")
SECTION = re.compile(r"(?ms)^## (?P<title>[^\n]*)\n(?P<text>.*?)(?=^## |\Z)")


def faults(root: Path, tag: str) -> list[str]:
    """Return what forbids the release, one line each."""
    title, _ = newest_section(root)
    problems = []
    if _only(VERSION, root / "app" / "__init__.py") != tag.removeprefix("v") or not tag.startswith("v"):
        problems.append(f"the tag {tag} is not v and the version in app/__init__.py")
    if not re.fullmatch(rf"{re.escape(tag.removeprefix('v'))} \(\d{{4}}-\d\d-\d\d\)", title):
        problems.append(f"CHANGELOG.md begins with '{title}', not with the version and its day")
    if _only(CITED, root / "CITATION.cff") != tag.removeprefix("v"):
        problems.append("CITATION.cff names another version")
    if "/OWNER/" in (root / "pyproject.toml").read_text(encoding="utf-8"):
        problems.append("pyproject.toml: OWNER stands for an address that has to be filled in")
    return problems


def newest_section(root: Path) -> tuple[str, str]:
    """Return title and text of the first section of the changelog."""
    section = SECTION.search((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    return (section["title"].strip(), section["text"].strip()) if section else ("", "")


def _only(pattern: re.Pattern[str], file: Path) -> str:
    match = pattern.search(file.read_text(encoding="utf-8"))
    return match[1] if match else ""


def main(arguments: list[str]) -> int:
    """Print the section and return 0, or the faults to standard error and return 1."""
    if len(arguments) != 1:
        print("say the tag: prove_release.py v1.0.0", file=sys.stderr)
        return 2
    problems = faults(ROOT, arguments[0])
    print("\n".join(problems), file=sys.stderr) if problems else print(newest_section(ROOT)[1])
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
