"""Checks of keys and numbers that come from outside: each is accepted, or refused with its key and limit."""

import argparse
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from simulator.errors import InputError

MAX_TIME_S = 1e8  # three years, longer than anybody plays
MAX_CURRENT_A = 1000.0  # 40 C, either way
_LONGEST_SHOWN = 40


@dataclass(frozen=True, slots=True)
class NumberRange:
    """The range of a number, ends included; `is_above` excludes the lower end."""

    minimum: float
    maximum: float
    unit: str = ""
    is_whole: bool = False
    is_above: bool = False

    def __str__(self) -> str:
        numbers = "the whole numbers " if self.is_whole else ""
        left_out = f" ({self.minimum:g} left out)" if self.is_above else ""
        return f"{numbers}{self.minimum:.10g}..{self.maximum:.10g} {self.unit}".rstrip() + left_out


AT_S = NumberRange(0, MAX_TIME_S, "s")
FOR_S = NumberRange(0, MAX_TIME_S, "s", is_above=True)
SHARE = NumberRange(0, 1)
AMBIENT_DEGC = NumberRange(-40, 80, "degC")
CURRENT_A = NumberRange(-MAX_CURRENT_A, MAX_CURRENT_A, "A")
MIN_SPEED, MAX_SPEED = 0.01, 1e6  # times real time
SEED = NumberRange(0, 2**32 - 1, is_whole=True)


def check_number(key: str, value: object, limits: NumberRange) -> float:
    """Return a value that is a number within its limits.

    Raises:
        InputError: it is none, or not within them.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(key, f"{key} = {shown(value)} is no number")
    is_low = value <= limits.minimum if limits.is_above else value < limits.minimum
    if is_low or not value <= limits.maximum or (limits.is_whole and value != int(value)):
        raise InputError(key, f"{key} = {shown(value)} is outside {limits}")
    return float(value)


def read_number(table: Mapping[str, Any], key: str, limits: NumberRange, default: float | None = None) -> float:
    """Return the number under a key, or the default.

    Raises:
        InputError: it is missing and there is no default, or as `check_number`.
    """
    value = table.get(key)
    if value is not None:
        return check_number(key, value, limits)
    if default is None:
        raise InputError(key, f"{key} is missing: {limits}")
    return default


def read_optional(table: Mapping[str, Any], key: str, limits: NumberRange) -> float | None:
    """Return the number under a key, None where there is none.

    Raises:
        InputError: as `check_number`.
    """
    return None if table.get(key) is None else read_number(table, key, limits)


def read_text(table: Mapping[str, Any], key: str) -> str:
    """Return the text under a key.

    Raises:
        InputError: it is missing, empty or no text.
    """
    value = table.get(key)
    if value is None or value == "":
        raise InputError(key, f"{key} is missing")
    if not isinstance(value, str):
        raise InputError(key, f"{key} = {shown(value)} is no text")
    return value


def read_choice(table: Mapping[str, Any], key: str, choices: Iterable[str]) -> str:
    """Return the text under a key, which is one of these.

    Raises:
        InputError: it is missing, or none of them.
    """
    text = read_text(table, key)
    names = tuple(choices)
    if text not in names:
        raise InputError(key, f"{key} {shown(text)} is none of {', '.join(names)}")
    return text


def refuse_unknown(table: Mapping[str, Any], keys: Iterable[str], what: str = "here") -> None:
    """Refuse the first unknown key.

    Raises:
        InputError: there is one.
    """
    names = sorted(keys)
    unknown = sorted(set(table) - set(names))
    if unknown:
        raise InputError(unknown[0], f"{shown(unknown[0])} means nothing {what}; known are {', '.join(names)}")


def shown(value: object) -> str:
    """Return a value as a message shows it: on one line, and never long."""
    try:
        text = repr(value)
    except ValueError:
        return "an integer of too many digits"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."


def number_option(limits: NumberRange) -> Callable[[str], float]:
    """Return the argparse type of an option that takes a number within limits."""

    def parse(text: str) -> float:
        try:
            number = int(text) if limits.is_whole else float(text)
            return check_number("it", number, limits)
        except (ValueError, InputError):
            raise argparse.ArgumentTypeError(f"{shown(text)} is outside {limits}") from None

    return parse
