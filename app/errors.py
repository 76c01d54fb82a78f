"""Errors of the service; each leaf is something a caller handles differently.

AppError
  ConfigError          a setting or a file of the user's is wrong: field, value, limit
  LinkError            LinkLost, MasterSilent, MasterRefused
  ImportFailed         another program's recording cannot be taken over
  ExtraMissing         an optional package is missing
  NotNow               the request is fine, the moment is not
  LimitExceeded        it takes more memory, time or room than anybody may
  WorkerEnded          the process that worked on it was ended from outside, or crashed
"""

from collections.abc import Mapping, Sequence
from typing import Any

from app.words import Message, Text, render
from firmware_protocol.errors import EncodeError
from firmware_protocol.names import closest

MOST_SHOWN = 300  # characters of a value in a message


class AppError(Exception):
    """Root of the service's own errors: each carries what it tells as a message."""

    def __init__(self, message: Text) -> None:
        self.message = Message("verbatim", text=message) if isinstance(message, str) else message
        super().__init__(self.message)

    def __str__(self) -> str:
        return render(self.message)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the error as it is, without its constructor: errors come out of other processes."""
        return rebuilt, (type(self), self.args, self.__dict__)


def rebuilt(kind: type[BaseException], args: tuple[Any, ...], values: dict[str, Any]) -> BaseException:
    """Return an error of another process, whatever its constructor takes."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(values)
    return error


def message_of(error: BaseException) -> Text:
    """Return the message of an error, or the words of another program."""
    return error.message if isinstance(error, AppError) else str(error) or type(error).__name__


class ConfigError(AppError):
    """A setting cannot be used; `limit` is what would be allowed."""

    def __init__(self, field: str, value: object, limit: Text) -> None:
        self.field = field
        self.value = value
        self.limit = limit.removeprefix(f"{value}: ") if isinstance(limit, str) else limit  # a file is named once
        super().__init__(Message("not-allowed", field=field, value=shown(value), limit=self.limit))


class LinkError(AppError):
    """The master cannot be talked to."""


class LinkLost(LinkError):
    """The port is not open."""


class MasterSilent(LinkError):
    """The port is open, the master did not answer in time."""


MEANINGS = {
    "UNKNOWN_REQUEST": Message("refused-unknown-request"),
    "BAD_LENGTH": Message("refused-bad-length"),
    "OUT_OF_BOUNDS": Message("refused-out-of-bounds"),
    "OUT_OF_RANGE": Message("refused-out-of-range"),
    "NOT_NOW": Message("refused-not-now"),
    "EEPROM_FAILED": Message("refused-eeprom-failed"),
    "NOTHING_STORED": Message("refused-nothing-stored"),
}


class MasterRefused(LinkError):
    """The master answered with a refusal."""

    def __init__(self, request: str, result: str, offset: int | None = None) -> None:
        self.request = request
        self.result = result
        self.offset = offset
        why = MEANINGS.get(result) or result
        if offset is None:
            super().__init__(Message("master-refused-why", request=request.lower(), why=why))
        else:
            super().__init__(Message("master-refused-at", request=request.lower(), why=why, offset=offset))


class NotNow(AppError):
    """The state of the service forbids it."""


class LimitExceeded(AppError):
    """A file asks for more than it may have; the message names the limit."""


class WorkerEnded(AppError):
    """A worker process was killed or crashed before it answered; none of our limits did it."""


class ImportFailed(AppError):
    """A recording of another program cannot be read as one of a battery."""

    def __init__(self, source: str, reason: Text) -> None:
        self.source = source
        self.reason = reason
        super().__init__(Message("of-source", source=source, reason=reason))


class ExtraMissing(AppError):
    """A format needs a package that is not installed."""

    def __init__(self, what: Text, package: str, extra: str) -> None:
        self.what = what
        self.package = package
        super().__init__(Message("extra-missing", what=what, package=package, extra=extra))


def shown(value: object) -> Message | str | int | float | None:
    """A value as an argument of a message, of a long one the beginning."""
    if isinstance(value, Message | int | float | None):
        return value
    text = str(value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."


def limit_of(error: EncodeError) -> Text:
    """Return the limit of a field that a value does not fit."""
    match error.kind:
        case "whole":
            return Message("whole-number", bounds=error.bounds)
        case "counts":
            return Message("whole-counts", bounds=error.bounds)
        case "number":
            return Message("a-number")
        case "array":
            return Message("an-array", shape=error.bounds)
        case "field":
            return Message("no-such-field")
        case "signal":
            return Message("a-signal")
        case "buffer":
            return Message("samples-of-buffer", bounds=error.bounds)
    return error.bounds


_KINDS = {
    "int": Message("a-whole-number"),
    "float": Message("a-number"),
    "bool": Message("true-or-false"),
    "string": Message("a-text"),
    "dict": Message("an-object"),
    "model": Message("an-object"),
}


def validation_text(error: Mapping[str, Any]) -> Text:
    """Return what is wrong with an input, from one of pydantic's `errors()`."""
    kind, context = str(error["type"]), error.get("ctx", {})
    match kind:
        case "missing":
            return Message("field-required")
        case "greater_than_equal":
            return Message("input-at-least", limit=context["ge"])
        case "less_than_equal":
            return Message("input-at-most", limit=context["le"])
        case "greater_than":
            return Message("input-above", limit=context["gt"])
        case "less_than":
            return Message("input-below", limit=context["lt"])
        case "literal_error" | "enum":
            return Message("input-must-be", what=Message("one-of", choices=context["expected"].replace("'", "")))
        case "extra_forbidden":
            return Message("field-unknown")
    if (what := _KINDS.get(kind.partition("_")[0])) and kind.endswith(("_type", "_parsing", "_attributes_type")):
        return Message("input-must-be", what=what)
    return str(error["msg"]).removeprefix("Value error, ").replace("Input should be", "must be")


def unknown_name(name: str, names: Sequence[str]) -> Message:
    """Return that a name is unknown, with the known ones and the one that was probably meant."""
    meant = closest(name, names)
    if meant is None:
        return Message("unknown-name", names=tuple(names))
    return Message("unknown-name-but", meant=meant, names=tuple(names))
