"""Messages that were stored as JSON with their English text."""

import json
from collections.abc import Mapping
from typing import Any

from app.words.message import Argument, Message, RenderedMessage, Text, coded, json_args, message_from_json
from app.words.render import render, table


def message_or_text(text: str, stored: str | None) -> Text:
    """Return the stored message; its English text alone where another version, or nobody of us, wrote it."""
    if stored is None:
        return text
    try:
        message: Message = message_from_json(json.loads(stored))
        render(message)
        return message if _has_template(message) else text
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError):
        return text


def rendered_as_stored(text: str, stored: str | None) -> RenderedMessage:
    """Return a stored message as it is sent, with the English text that was stored."""
    message = coded(message_or_text(text, stored))
    return RenderedMessage(message.code, json_args(message), text)


def rendered_from_json(body: Mapping[str, Any]) -> RenderedMessage:
    """Return a message that was kept as it was sent, with the code that a condition has today.

    Raises:
        KeyError, TypeError: it is not one.
    """
    message = message_from_json(body)
    return RenderedMessage(message.code, json_args(message), body["text"])


def _has_template(argument: Argument) -> bool:
    match argument:
        case Message():
            return argument.code in table("en") and all(map(_has_template, argument.args.values()))
        case tuple():
            return all(map(_has_template, argument))
    return True
