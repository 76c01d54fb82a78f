"""The words of the service: codes with arguments, and the tables that turn them into text."""

from app.words.conditions import condition_of
from app.words.message import (
    Argument,
    Cell,
    Message,
    Pack,
    Quantity,
    RenderedMessage,
    Text,
    condition,
    message_from_json,
)
from app.words.render import languages, place_of, render, rendered, rendered_or_none, sentence, table
from app.words.stored import message_or_text, rendered_as_stored, rendered_from_json

__all__ = [
    "Argument",
    "Cell",
    "Message",
    "Pack",
    "Quantity",
    "RenderedMessage",
    "Text",
    "condition",
    "condition_of",
    "languages",
    "message_from_json",
    "message_or_text",
    "place_of",
    "render",
    "rendered",
    "rendered_as_stored",
    "rendered_from_json",
    "rendered_or_none",
    "sentence",
    "table",
]
