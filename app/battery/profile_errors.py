"""Every error of a profile at once: what is wrong is set aside, and the rest is read again."""

import copy
import re
from collections.abc import Mapping
from typing import Any

from app.battery.fields import TABLES, KindOfField
from app.battery.profile import BatteryProfile, Document, understand
from app.battery.table_reader import ProfileError

_MOST = 200
_HARMLESS: dict[KindOfField, Any] = {"texts": ["-"], "counts": [1]}  # where a field must be there; else a text
_SHAPED_BY_PACKS = (
    "temperatures.cells",
    "drawing.order",
    "drawing.turned",
)  # not to be judged while the packs are wrong


def errors_of(document: Document) -> tuple[list[ProfileError], BatteryProfile | None]:
    """Return all errors, by line, and what is left of the profile without them; None where nothing can be made of it.

    Args:
        document: the tables of a profile.
    """
    values = copy.deepcopy(dict(document.values))
    errors: dict[str, ProfileError] = {}
    profile = None
    for _ in range(_MOST):
        try:
            profile = understand(Document(document.file, values, document.lines))
            break
        except ProfileError as error:
            is_again = error.path in errors
            errors.setdefault(error.path, error)
            if not _set_aside(values, error.path, is_needed=is_again or not _is_there(values, error.path)):
                break
            if error.path == "battery.packs":
                for name in _SHAPED_BY_PACKS:
                    _remove(values, f"battery.{name}")
    return sorted(errors.values(), key=lambda error: error.line or 0), profile


def _set_aside(values: dict[str, Any], path: str, *, is_needed: bool) -> bool:
    """Remove a key, or give one that must be there a harmless value; False where that is no way on."""
    if not is_needed:
        return _remove(values, path)
    table, name = _around(values, path)
    fields = TABLES.get(re.sub(r"\[\d+\]", "", path).rpartition(".")[0], ())
    field = next((field for field in fields if field.name == name), None)
    if field is None or field.default or not isinstance(table, dict):
        return False
    harmless = _HARMLESS.get(field.kind, field.one_of[0] if field.one_of else "-")
    if table.get(name) == harmless:
        return False
    table[name] = harmless
    return True


def _remove(values: dict[str, Any], path: str) -> bool:
    table, name = _around(values, path)
    if isinstance(table, list) and name.isdigit() and int(name) < len(table):
        table[int(name)] = {}
        return True
    return isinstance(table, dict) and table.pop(name, None) is not None


def _is_there(values: dict[str, Any], path: str) -> bool:
    table, name = _around(values, path)
    return (isinstance(table, Mapping) and name in table) or isinstance(table, list)


def _around(values: dict[str, Any], path: str) -> tuple[Any, str]:
    """The table or list that holds a key, made where there is none, and the key's own name."""
    *outer, name = re.findall(r"[^.\[\]]+", path)
    at: Any = values
    for key in outer:
        if isinstance(at, dict):
            at = at.setdefault(key, {})
        elif isinstance(at, list) and key.isdigit() and int(key) < len(at):
            at = at[int(key)]
        else:
            return None, name
    return at, name
