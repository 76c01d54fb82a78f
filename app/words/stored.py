"""Messages that were stored as JSON beside their English text."""

import json

from app.words.message import Message, Text, message_from_json
from app.words.render import render


def message_or_text(text: str, stored: str | None) -> Text:
    """Return the stored message; its English text alone where an earlier version, or nobody of us, wrote it."""
    if stored is None:
        return text
    try:
        message: Message = message_from_json(json.loads(stored))
        render(message)
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError):
        return text
    return message
