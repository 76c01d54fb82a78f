"""What the service tells a person, for whoever wants it in another language than English."""

from typing import Any

from pydantic import BaseModel


class WordsOut(BaseModel):
    """A code and its arguments: numbers, texts, cells, quantities with their unit, and messages within messages."""

    code: str
    args: dict[str, Any]
