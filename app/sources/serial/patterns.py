"""Expressions of a profile against a line, by RE2: in linear time, whatever the expression."""

from functools import cache
from typing import Any

from app.errors import ExtraMissing


@cache
def _compiled(pattern: str) -> Any:
    try:
        import re2  # an extra: most profiles have none
    except ImportError as error:
        raise ExtraMissing("a pattern of a serial line", "google-re2", "serial-pattern") from error
    options = re2.Options()
    options.log_errors = False
    try:
        return re2.compile(pattern, options)
    except re2.error as error:
        raise ValueError(str(error)) from error


def group_names(pattern: str) -> tuple[str, ...]:
    """Return the named groups of an expression.

    Raises:
        ValueError: it is none.
        ExtraMissing: RE2 is not installed.
    """
    return tuple(_compiled(pattern).groupindex)


def groups_of(pattern: str, text: str) -> dict[str, str]:
    """Return the named groups of the first match in a line.

    Raises:
        ValueError: it does not match, or the expression is none.
        ExtraMissing: RE2 is not installed.
    """
    match = _compiled(pattern).search(text)
    if match is None:
        raise ValueError("the line does not match")
    return {name: value or "" for name, value in match.groupdict().items()}


def is_match(pattern: str, text: str) -> bool:
    """Return whether an expression matches somewhere in a line.

    Raises:
        ValueError: the expression is none.
        ExtraMissing: RE2 is not installed.
    """
    return _compiled(pattern).search(text) is not None
