"""A message is a code with arguments. It holds no sentence: `render` makes one, in the language of whoever reads it.

`dataclasses.asdict` gives its JSON form, `message_from_json` takes that back. What is sent is a `RenderedMessage`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from app.words.conditions import condition_of


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell by its index from 0; `render` names its pack and number, both from 1."""

    index: int


@dataclass(frozen=True, slots=True)
class Pack:
    """A pack by its index from 0; people read its number, from 1."""

    pack: int


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with its unit; `digits` after the point, or as many as it needs up to six significant ones."""

    value: float | None
    unit: str
    digits: int | None = None


@dataclass(frozen=True, slots=True, init=False)
class Message:
    """A text to be rendered: `code` names the template, `args` are its values.

    A text argument is a name (a file, a person, another program's error) and is the same in every language. What has
    to be translated is a message of its own.
    """

    code: str
    args: Mapping[str, Argument] = field(hash=False)

    def __init__(self, code: str, /, **args: Argument) -> None:
        object.__setattr__(self, "code", code)
        object.__setattr__(self, "args", args)

    def having(self, **args: Argument) -> Message:
        """Return the same message with other values of some arguments."""
        return Message(self.code, **{**self.args, **args})


Text = Message | str  # what other programs say, an operating system for one, has no code
Argument = str | int | float | None | Cell | Pack | Quantity | Message | tuple["Argument", ...]


@dataclass(frozen=True, slots=True)
class RenderedMessage:
    """A message as it is sent: code and arguments, and its English text with the cells of its battery."""

    code: str
    args: Mapping[str, Any]
    text: str

    @property
    def message(self) -> Message:
        """The message, to be part of another one."""
        return message_from_json({"code": self.code, "args": self.args})


def coded(text: Text) -> Message:
    """Return a text without a code as a message of its own."""
    return Message("verbatim", text=text) if isinstance(text, str) else text


def json_args(message: Message) -> Mapping[str, Any]:
    """Return the arguments of a message as JSON holds them; several times as quick as `asdict`."""
    return {name: _json(arg) for name, arg in message.args.items()}


def _json(argument: Argument) -> Any:
    match argument:
        case Message():
            return {"code": argument.code, "args": json_args(argument)}
        case Cell(index):
            return {"index": index}
        case Pack(pack):
            return {"pack": pack}
        case Quantity(value, unit, digits):
            return {"value": value, "unit": unit, "digits": digits}
        case tuple():
            return [_json(element) for element in argument]
    return argument


def condition(code: str, n: int = 1) -> Message:
    """Return the name of a condition by its code, of `n` cells or others that have it."""
    return Message(code, n=n)


def message_from_json(value: Mapping[str, Any]) -> Message:
    """Return the message of which `value` is the JSON form; the code of a condition is today's.

    Raises:
        KeyError, TypeError: it is not one.
    """
    return Message(
        condition_of(value["code"]), **{name: _argument(argument) for name, argument in value["args"].items()}
    )


def _argument(value: Any) -> Argument:
    if isinstance(value, list | tuple):  # `asdict` leaves a tuple a tuple, JSON makes a list of it
        return tuple(_argument(element) for element in value)
    if not isinstance(value, dict):
        plain: str | int | float | None = value
        return plain
    if "code" in value:
        return message_from_json(value)
    if "index" in value:  # earlier versions stored its pack and number, too
        return Cell(value["index"])
    if "pack" in value:
        return Pack(value["pack"])
    return Quantity(**value)
