"""What the service tells a person: codes with arguments, and the tables that turn them into text."""

from app.words.message import Argument, Cell, Message, Quantity, Text, message_from_json
from app.words.places import name_cells_by, naming_cells
from app.words.render import languages, render, table
from app.words.stored import message_or_text

__all__ = [
    "Argument",
    "Cell",
    "Message",
    "Quantity",
    "Text",
    "languages",
    "message_from_json",
    "message_or_text",
    "name_cells_by",
    "naming_cells",
    "render",
    "table",
]
