"""The line on which a key of a TOML text stands, for error messages; tomllib does not tell."""

import re

_TABLE = re.compile(r"\s*(\[\[?)\s*([\w.\-\" ]+?)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"\s*([\w\-\"]+(?:\s*\.\s*[\w\-\"]+)*)\s*=")


def lines_of_keys(text: str) -> dict[str, int]:
    """Return the line of each table and key by its path, `source.voltage[0].signal`."""
    found: dict[str, int] = {}
    counts: dict[str, int] = {}
    table = ""
    for number, line in enumerate(text.splitlines(), 1):
        head = _TABLE.match(line)
        if head:
            table = _within(_clean(head[2]), counts)
            if head[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = f"{table}[{counts[table]}]"
            found.setdefault(table, number)
            continue
        key = _KEY.match(line)
        if key:
            path = f"{table}.{_clean(key[1])}" if table else _clean(key[1])
            found.setdefault(path, number)
    return found


def line_of(lines: dict[str, int], path: str) -> int | None:
    """The line of a key, else of the nearest table around it."""
    while path:
        if path in lines:
            return lines[path]
        path = re.sub(r"(\.[^.\[]+|\[\d+\]|^[^.\[]+)$", "", path)
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
