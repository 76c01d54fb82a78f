"""Patterns of names: `CELL_{cell}`, `Seg{segment:a}_*`; what a name's numbers say."""

import re
from functools import cache

from app.battery.source import PARTS

_PLACEHOLDER = re.compile(r"\{(\w+)(:a)?\}|\*")


class PatternError(ValueError):
    """A placeholder that is none of the parts of a cell's number."""


@cache
def compiled(pattern: str) -> re.Pattern[str]:
    """Return a pattern as a regular expression over whole names.

    Raises:
        PatternError: a placeholder is none of the parts.
    """
    text, at, seen = "", 0, set[str]()
    for found in _PLACEHOLDER.finditer(pattern):
        text += re.escape(pattern[at : found.start()])
        at = found.end()
        name = found[1]
        if name is None:
            text += ".*"
        elif name not in PARTS:
            raise PatternError(name)
        elif name in seen:
            text += f"(?P={name})"
        else:
            seen.add(name)
            text += f"(?P<{name}>[A-Za-z])" if found[2] else rf"(?P<{name}>\d+)"
    return re.compile(text + re.escape(pattern[at:]) + r"\Z")


def numbers_in(pattern: str, name: str, base: dict[str, int]) -> dict[str, int] | None:
    """Return the numbers of a name by part, None where the pattern does not fit; the letter A is the base."""
    found = compiled(pattern).match(name)
    if found is None:
        return None
    return {
        part: int(text) if text.isdigit() else ord(text.upper()) - ord("A") + base.get(part, 0)
        for part, text in found.groupdict().items()
    }


def filled(pattern: str, numbers: dict[str, str]) -> str:
    """Return a pattern with the texts of another name's parts in it; `*` and others stay."""
    return _PLACEHOLDER.sub(lambda found: numbers.get(found[1] or "", found[0]), pattern)


def texts_in(pattern: str, name: str) -> dict[str, str]:
    """Return the parts of a name as they are written."""
    found = compiled(pattern).match(name)
    return found.groupdict() if found else {}
