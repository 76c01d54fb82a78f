"""Messages in answers: the English text for scripts, and beside it code and arguments for pages in other languages."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from app.words import Message, Text, render


def message_json(name: str, message: Text | None) -> dict[str, Any]:
    """Return the field `name` with the text, and `name`_words with the message, null for a text without a code."""
    return {name: None if message is None else render(message), f"{name}_words": words(message)}


def messages_json(name: str, messages: Sequence[Message]) -> dict[str, Any]:
    """Return the field `name` with the texts, and `name`_words with the messages."""
    return {name: [render(each) for each in messages], f"{name}_words": [words(each) for each in messages]}


def words(message: Text | None) -> dict[str, Any] | None:
    """Return code and arguments, None where there are none."""
    return asdict(message) if isinstance(message, Message) else None
