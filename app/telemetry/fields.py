"""Meaning of a snapshot's fields: unit, meaning and decimals stand in its type, and are read from there.

The JSON encoder, the OpenAPI schema, history, MQTT and the expectations of a replay test take them from here.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from app.words import Message

Part = Literal["current", "voltage", "temperature", "status", "soc", "charger", "slaves", "config"]


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit and meaning of a number, and how many decimals of it are sent (None: all)."""

    unit: str
    meaning: str
    decimals: int | None = 6


@dataclass(frozen=True, slots=True)
class Kept:
    """History keeps this value; it is as old as the named part of the measurement."""

    part: Part


@dataclass(frozen=True, slots=True)
class SentAs:
    """The name in JSON where it is another; `divisor` turns the number into the unit that is sent."""

    name: str
    divisor: float | None = None


@dataclass(frozen=True, slots=True)
class _Mark:
    name: str


TREND = _Mark("trend")  # changes slowly: kept for hours
INTERNAL = _Mark("internal")  # not sent
LEFT_OUT = _Mark("left out")  # not sent where it is None: most batteries have no such value


@dataclass(frozen=True, slots=True)
class Described:
    """One field of a dataclass: its type without what was annotated, and the annotations."""

    name: str
    type: Any
    marks: tuple[Any, ...]

    def mark(self, kind: type) -> Any:
        """Return the annotation of a kind, None without one."""
        return next((mark for mark in self.marks if isinstance(mark, kind)), None)

    @property
    def is_internal(self) -> bool:
        """The field is not sent."""
        return INTERNAL in self.marks

    @property
    def may_be_left_out(self) -> bool:
        """The field is sent where it is known only."""
        return LEFT_OUT in self.marks

    @property
    def is_message(self) -> bool:
        """The field is a message: its code and arguments are sent, and its English text."""
        return Message in (self.type, *get_args(self.type))

    @property
    def json_name(self) -> str:
        """The field's name in JSON."""
        sent: SentAs | None = self.mark(SentAs)
        return self.name if sent is None else sent.name


@cache
def described(owner: type) -> tuple[Described, ...]:
    """Return the fields of a dataclass in their order."""
    hints = get_type_hints(owner, include_extras=True)
    marked = []
    for field in fields(owner):
        hint = hints[field.name]
        if get_origin(hint) is Annotated:
            inner, *marks = get_args(hint)
            marked.append(Described(field.name, inner, tuple(marks)))
        else:
            marked.append(Described(field.name, hint, ()))
    return tuple(marked)


def marked(owner: type, mark: object) -> tuple[str, ...]:
    """Return the names of the fields that carry a mark."""
    return tuple(field.name for field in described(owner) if mark in field.marks)


def units(owner: type) -> Iterator[tuple[str, Unit]]:
    """Yield the fields that are numbers with a unit."""
    for field in described(owner):
        unit: Unit | None = field.mark(Unit)
        if unit is not None:
            yield field.name, unit


def history_fields(owner: type) -> Iterator[tuple[str, Unit, Part]]:
    """Yield the fields that history keeps, with the part of the measurement that they are as old as."""
    for field in described(owner):
        keeping: Kept | None = field.mark(Kept)
        if keeping is not None:
            yield field.name, field.mark(Unit), keeping.part
