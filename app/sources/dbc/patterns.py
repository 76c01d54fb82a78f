"""Patterns of names: `CELL_{cell}`, `Seg{pack:a}_*`; what a name's numbers say."""

import re
from functools import cache
from typing import Final

from app.battery.source import LONGEST_PATTERN, MOST_PLACEHOLDERS, PARTS, part_of
from app.words import Message

_DIGITS: Final = 9  # digits of a number
_PLACEHOLDER = re.compile(r"\{(\w{1,20})(:a)?\}|\*")
_STAR: Final = "*"
_Token = tuple[str, str]  # a part and "a" or "0"; _STAR and ""; "" and a text that stands for itself
_Texts = tuple[tuple[str, str], ...]  # parts as they are written


class PatternError(ValueError):
    """A placeholder that is none of the parts of a cell's number, or a pattern that is too long: a `Message`."""


@cache
def tokens(pattern: str) -> tuple[_Token, ...]:
    """Return what a pattern consists of, in order.

    Raises:
        PatternError: a placeholder is none of the parts, or the pattern is too long.
    """
    placeholders = list(_PLACEHOLDER.finditer(pattern))
    if len(pattern) > LONGEST_PATTERN or len(placeholders) > MOST_PLACEHOLDERS:
        raise PatternError(Message("pattern-too-long", most=LONGEST_PATTERN, placeholders=MOST_PLACEHOLDERS))
    parts: list[_Token] = []
    at = 0
    for placeholder in placeholders:
        parts.append(("", pattern[at : placeholder.start()]))
        at = placeholder.end()
        part = None if placeholder[1] is None else part_of(placeholder[1])
        if part is not None and part not in PARTS:
            raise PatternError(Message("no-such-placeholder", name=placeholder[1]))
        parts.append((_STAR, "") if part is None else (part, "a" if placeholder[2] else "0"))
    return (*parts, ("", pattern[at:]))


def numbers_in(pattern: str, name: str, base: dict[str, int]) -> dict[str, int] | None:
    """Return the numbers of a name by part, None where the pattern does not fit; the letter A is the base.

    Raises:
        PatternError: as `tokens`.
    """
    texts = _matched(pattern, name)
    if texts is None:
        return None
    return {
        part: int(text) if text.isdigit() else ord(text.upper()) - ord("A") + base.get(part, 0)
        for part, text in texts.items()
    }


def filled(pattern: str, numbers: dict[str, str]) -> str:
    """Return a pattern with the texts of another name's parts in it; `*` and others stay."""
    return _PLACEHOLDER.sub(lambda match: numbers.get(part_of(match[1] or ""), match[0]), pattern)


def texts_in(pattern: str, name: str) -> dict[str, str]:
    """Return the parts of a name as they are written."""
    return _matched(pattern, name) or {}


def _matched(pattern: str, name: str) -> dict[str, str] | None:
    """The parts of a name that fits as a whole, each placeholder as long as it can be; None where it does not fit."""
    parts = tokens(pattern)
    if len(name) > LONGEST_PATTERN:
        return None
    failed: set[tuple[int, int, _Texts]] = set()  # where no rest of the pattern fits: each is tried once

    def rest(index: int, at: int, texts: _Texts) -> _Texts | None:
        if index == len(parts):
            return texts if at == len(name) else None
        if (index, at, texts) in failed:
            return None
        kind, what = parts[index]
        for end in ends(kind, what, at, texts):
            more = texts if kind in ("", _STAR) else tuple({**dict(texts), kind: name[at:end]}.items())
            fits = rest(index + 1, end, more)
            if fits is not None:
                return fits
        failed.add((index, at, texts))
        return None

    def ends(kind: str, what: str, at: int, texts: _Texts) -> range | tuple[int, ...]:
        """Return where a token that begins there can end, the longest first."""
        if kind == _STAR:
            return range(len(name), at - 1, -1)
        before = what if kind == "" else dict(texts).get(kind)
        if before is not None:
            return (at + len(before),) if name.startswith(before, at) else ()
        if what == "a":
            return (at + 1,) if name[at : at + 1].isascii() and name[at : at + 1].isalpha() else ()
        end = at
        while end < min(len(name), at + _DIGITS) and name[end].isdecimal():
            end += 1
        return range(end, at, -1)

    numbers = rest(0, 0, ())
    return None if numbers is None else dict(numbers)
