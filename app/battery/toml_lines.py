"""The line on which a key of a TOML text stands, for error messages; tomllib does not tell."""

import re
from collections.abc import Mapping

_TABLE = re.compile(r"\s*+(\[\[?)([\w.\-\" \t]++)\]\]?\s*+(?:#.*)?$")
_KEY = re.compile(r"\s*+([\w.\-\" \t]++)=")
_LONGEST = 300  # characters of a path: none of a profile's is a tenth as long


def lines_of_keys(text: str) -> dict[str, int]:
    """Return the line of each table and key by its path, `source.voltage[0].signal`."""
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    table = ""
    for number, line in enumerate(text.splitlines(), 1):
        head, key = _TABLE.match(line), _KEY.match(line)
        path = _clean(head[2] if head else key[1] if key else "")
        if not 0 < len(path) <= _LONGEST:
            continue
        if head:
            table = _within(path, counts)
            if head[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = f"{table}[{counts[table]}]"
            lines.setdefault(table, number)
        else:
            lines.setdefault(f"{table}.{path}" if table else path, number)
    return lines


def line_of(lines: Mapping[str, int], path: str) -> int | None:
    """The line of a key, else of the nearest table around it."""
    while path:
        if path in lines:
            return lines[path]
        path = path[: max(path.rfind("."), path.rfind("["), 0)]
    return None


def _within(table: str, counts: dict[str, int]) -> str:
    """The path of a table, with the number of the list's last element where one is around it."""
    around, _, name = table.rpartition(".")
    if not around:
        return table
    around = _within(around, counts)
    return f"{around}[{counts[around]}].{name}" if around in counts else f"{around}.{name}"


def _clean(key: str) -> str:
    return re.sub(r"[\s\"]", "", key)
