"""Values out of the tables of a profile: each of its kind and within its bounds, errors by line and field."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

from app.battery.battery import Limit, SignalName
from app.battery.fields import Field
from app.battery.source import LONGEST_PATTERN, MOST_PLACEHOLDERS, PARTS, part_of
from app.battery.toml_lines import line_of
from app.errors import ConfigError
from app.words import Message, Text


class ProfileError(ConfigError):
    """A profile cannot be used: file, line, field, value and what would be allowed."""

    def __init__(self, file: str, line: int | None, field: str, value: object, limit: Text) -> None:
        self.file = file
        self.line = line
        self.path = field
        place = file if line is None else f"{file}:{line}"
        super().__init__(field if value == file else f"{place}: {field}", value, limit)


@dataclass(frozen=True, slots=True)
class TableReader:
    """One table of a profile, read by its fields."""

    file: str
    path: str  # path of the table, such as `source.voltage[0]`
    values: Mapping[str, Any]
    fields: Sequence[Field]
    lines: Mapping[str, int]

    def error(self, name: str, value: object, limit: Text) -> ProfileError:
        """An error of one of its fields."""
        path = f"{self.path}.{name}".strip(".")
        return ProfileError(self.file, line_of(self.lines, path), path, value, limit)

    @property
    def line(self) -> int | None:
        """Return the line on which the table begins."""
        return line_of(self.lines, self.path)

    def check_names(self, tables: Iterable[str] = ()) -> None:
        """Raise ProfileError for a key that is no field and none of the tables within."""
        names = [field.name for field in self.fields]
        for name in self.values:
            if name not in names and name not in tables:
                raise self.error(name, _short(self.values[name]), Message("no-such-key", names=(*names, *tables)))
        for field in self.fields:
            if field.default == "" and field.name not in self.values:
                raise self.error(field.name, "", Message("key-missing", meaning=field.meaning))

    def _field(self, name: str) -> Field:
        return next(field for field in self.fields if field.name == name)

    def text(self, name: str, default: str = "") -> str:
        """Return a text, one of those that its field allows."""
        value = self.values.get(name, default)
        field = self._field(name)
        if not isinstance(value, str) or (name in self.values and not value):
            raise self.error(name, _short(value), Message("kind-text"))
        if field.one_of and value and value not in field.one_of:
            raise self.error(name, value, Message("one-of-these", names=field.one_of))
        return value

    def pattern(self, name: str, default: str = "") -> str:
        """Return a pattern of names, within what a name is compared with in little time."""
        value = self.text(name, default)
        if len(value) > LONGEST_PATTERN or value.count("*") + value.count("{") > MOST_PLACEHOLDERS:
            limit = Message("pattern-too-long", most=LONGEST_PATTERN, placeholders=MOST_PLACEHOLDERS)
            raise self.error(name, _short(value), limit)
        return value

    def texts(self, name: str) -> tuple[str, ...]:
        """Return a list of texts; one text is a list of one."""
        value = self.values.get(name, [])
        texts = [value] if isinstance(value, str) else value
        if not isinstance(texts, list) or not all(isinstance(text, str) and text for text in texts):
            raise self.error(name, _short(value), Message("kind-texts"))
        return tuple(texts)

    def number(self, name: str, default: float) -> float:
        """Return a number within its field's bounds."""
        value = self.values.get(name, default)
        if name not in self.values:
            return default
        return self._number(name, value, self._field(name))

    def optional_number(self, name: str) -> float | None:
        """Return a number, None where the profile has none."""
        return self._number(name, self.values[name], self._field(name)) if name in self.values else None

    def _number(self, name: str, value: object, field: Field) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(name, _short(value), Message("kind-number", bounds=_bounds(field)))
        if not isfinite(value) or not field.low <= value <= field.high:
            raise self.error(name, value, Message("kind-number", bounds=_bounds(field)))
        return float(value)

    def count(self, name: str, default: int) -> int:
        """Return a whole number within its field's bounds."""
        return self._count(name, self.values[name], self._field(name)) if name in self.values else default

    def _count(self, name: str, value: object, field: Field) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not field.low <= value <= field.high:
            raise self.error(name, _short(value), Message("kind-count", bounds=_bounds(field)))
        return value

    def flag(self, name: str) -> bool:
        """Return whether a field is true."""
        value = self.values.get(name, False)
        if not isinstance(value, bool):
            raise self.error(name, _short(value), Message("kind-flag"))
        return value

    def counts(self, name: str) -> tuple[int, ...] | None:
        """Return a list of whole numbers, each within its field's bounds; None where the profile has none."""
        if name not in self.values:
            return None
        value = self.values[name]
        if not isinstance(value, list):
            raise self.error(name, _short(value), Message("kind-counts", bounds=_bounds(self._field(name))))
        return tuple(self._count(name, number, self._field(name)) for number in value)

    def pair(self, name: str) -> tuple[float, float] | None:
        """Return two numbers, the lower one first; None where the profile has none."""
        if name not in self.values:
            return None
        value = self.values[name]
        if not isinstance(value, list) or len(value) != 2 or not all(_is_number(number) for number in value):
            raise self.error(name, _short(value), Message("kind-pair"))
        if not -inf < value[0] < value[1] < inf:
            raise self.error(name, _short(value), Message("kind-pair"))
        return float(value[0]), float(value[1])

    def signal(self, name: str) -> SignalName:
        """Return the name of a signal."""
        return signal_name(self.text(name))

    def limit(self, name: str) -> Limit | None:
        """Return a number, or the signal that carries it; None where the profile has none."""
        value = self.values.get(name)
        if value is None:
            return None
        if isinstance(value, dict) and set(value) == {"signal"} and isinstance(value["signal"], str):
            return signal_name(value["signal"])
        if isinstance(value, dict):
            raise self.error(name, _short(value), Message("kind-limit", bounds=_bounds(self._field(name))))
        return self._number(name, value, self._field(name))

    def parts(self, name: str) -> dict[str, str]:
        """Return patterns by part of a cell's number."""
        value = self.values.get(name, {})
        if not isinstance(value, dict) or not all(isinstance(part, str) and part for part in value.values()):
            raise self.error(name, _short(value), Message("kind-parts", names=PARTS))
        self._check_parts(name, value)
        return {part_of(part): pattern for part, pattern in value.items()}

    def _check_parts(self, name: str, value: Mapping[str, Any]) -> None:
        for part in value:
            if part_of(part) not in PARTS:
                raise self.error(f"{name}.{part}", value[part], Message("no-such-key", names=PARTS))

    def bases(self, name: str) -> dict[str, int]:
        """Return the lowest number of each part."""
        value = self.values.get(name, 0)
        field = self._field(name)
        if isinstance(value, dict):
            self._check_parts(name, value)
            return {part_of(part): self._count(f"{name}.{part}", number, field) for part, number in value.items()}
        return dict.fromkeys(PARTS, self._count(name, value, field))


def signal_name(text: str) -> SignalName:
    """Return `MESSAGE.SIGNAL` or `SIGNAL` as a name."""
    message, _, signal = text.rpartition(".")
    return SignalName(message, signal)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _bounds(field: Field) -> str:
    low, high = (None if abs(bound) >= 2**63 else f"{bound:g}" for bound in (field.low, field.high))
    if low is None or high is None:
        return "" if low is high else (f">= {low}" if high is None else f"<= {high}")
    return f"{low}..{high}"


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
