"""The common part of every list that may grow."""

from pydantic import BaseModel


class PageOut(BaseModel):
    """A page of a list; `next_cursor` asks for the next one, null on the last."""

    next_cursor: str | None
