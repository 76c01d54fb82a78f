"""TOML that comes from elsewhere: what is too long, too deep or too large is refused before it takes time or memory.

The parser of the standard library takes quadratic time for a key of many parts, and raises whatever it meets first
for deep nesting and for numbers of many digits.
"""

from __future__ import annotations

import re
import tomllib
from typing import Any, Final

MOST_CHARACTERS: Final = 262_144  # the longest text of ours has 13,000
MOST_LEVELS: Final = 8  # levels of brackets within each other and parts of a key, `a.b.c`, together
MOST_OF_A_KEY: Final = 200  # characters
LOWEST, HIGHEST = -(2**63), 2**64 - 1  # range of a whole number
_MARK: Final = re.compile(r"""["'#\[\]{}.,\n]""")
_STRING_ENDS: Final = {
    '"""': re.compile(r'"""|\\.', re.DOTALL),
    "'''": re.compile("'''"),
    '"': re.compile(r'["\n]|\\.', re.DOTALL),
    "'": re.compile("['\n]"),
}


class TomlError(ValueError):
    """A text is no TOML, or beyond what is read.

    `line` counts from 1, None where it is not known; `field` is the key of a number that is too large, as `a.b`.
    """

    def __init__(self, reason: str, line: int | None = None, field: str = "") -> None:
        self.line = line
        self.field = field
        self.reason = reason
        super().__init__(f"{field}: {reason}" if field else reason)


def read_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Raises:
        TomlError: it is no TOML, has more than MOST_CHARACTERS or MOST_LEVELS, a longer key than
            MOST_OF_A_KEY, or a whole number beyond 64 bits.
    """
    if len(text) > MOST_CHARACTERS:
        raise TomlError(f"{len(text)} characters; at most {MOST_CHARACTERS} are read")
    _check_levels(text)
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = re.search(r"line (\d+)", str(error))
        raise TomlError(str(error), int(match[1]) if match else None) from error
    except ValueError as error:  # a whole number of more digits than Python converts
        raise TomlError(f"a whole number is not within {LOWEST}..{HIGHEST}") from error
    _check_values(tables)
    return tables


def _check_levels(text: str) -> None:
    """Follow brackets and dots outside of strings and comments, in one pass."""
    around: list[int] = []  # for each open bracket the parts of the key before it
    outer = parts = at = 0
    while match := _MARK.search(text, at):
        mark, at = match[0], match.end()
        if mark in "\"'":
            at = _end_of_string(text, match.start())
        elif mark == "#":
            end = text.find("\n", at)
            at = len(text) if end < 0 else end
        elif mark in "[{":
            around.append(parts)
            outer, parts = outer + parts + 1, 0
        elif mark in "]}":
            parts = around.pop() if around else 0
            outer = max(outer - parts - 1, 0)
        else:
            parts = parts + 1 if mark == "." else 0
        if outer + parts > MOST_LEVELS:
            line = text.count("\n", 0, at) + 1
            raise TomlError(f"more than {MOST_LEVELS} levels of brackets and parts of a key (at line {line})", line)


def _end_of_string(text: str, start: int) -> int:
    """Where the string that starts there ends; the end of the text where it does not."""
    quotes = text[start : start + 3] if text.startswith(text[start] * 3, start) else text[start]
    at = start + len(quotes)
    while match := _STRING_ENDS[quotes].search(text, at):
        at = match.end()
        if not match[0].startswith("\\"):
            return at
    return len(text)


def _check_values(tables: dict[str, Any]) -> None:
    waiting: list[tuple[str, Any]] = [("", tables)]
    while waiting:
        path, value = waiting.pop()
        if isinstance(value, dict):
            if longest := next((key for key in value if len(key) > MOST_OF_A_KEY), None):
                raise TomlError(f"{longest[:30]}...: a key of {len(longest)} characters; at most {MOST_OF_A_KEY}")
            waiting += [(f"{path}.{key}".lstrip("."), value_below) for key, value_below in value.items()]
        elif isinstance(value, list):
            waiting += [(path, element) for element in value]
        elif isinstance(value, int) and not LOWEST <= value <= HIGHEST:
            raise TomlError(f"a whole number is not within {LOWEST}..{HIGHEST}", field=path)
