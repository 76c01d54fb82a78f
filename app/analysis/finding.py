"""What an analysis says: a code with its arguments for the pages, and the same in English for scripts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from app.words import Argument, Cell, Message, Text, message_from_json, message_or_text, render


@dataclass(frozen=True)
class AnalysisFinding:
    """One thing that is said; `code` and `args` are the JSON form of a message, `text` is that message in English."""

    code: str
    args: Mapping[str, object]
    text: str

    @property
    def message(self) -> Message:
        """The message, to be part of another one."""
        return message_from_json({"code": self.code, "args": self.args})


def finding(message: Message) -> AnalysisFinding:
    """Return a message as a sentence: its English text begins with a capital letter."""
    text = render(message)
    return AnalysisFinding(message.code, json_args(message), text[:1].upper() + text[1:])


def json_args(message: Message) -> Mapping[str, object]:
    """Return the arguments of a message as JSON holds them."""
    args: Mapping[str, object] = asdict(message)["args"]
    return args


def message_of_event(row: Mapping[str, Any]) -> Text:
    """Return what an event of a session says; its English text alone where an earlier version, or nobody, wrote it."""
    return message_or_text(row["text"], row.get("message"))


def english(text: Text) -> str:
    """Return a text in English."""
    return text if isinstance(text, str) else render(text)


def finding_or_none(text: Text) -> AnalysisFinding | None:
    """Return what has a code as a finding, None for a text without one."""
    return None if isinstance(text, str) else AnalysisFinding(text.code, json_args(text), render(text))


def with_cell(event: Text, cell: int | None) -> Argument:
    """Return what an event says, with the cell's place where it does not name it."""
    if cell is None or render(Message("at-cell", cell=Cell(cell))) in english(event):
        return event
    return Message("reported-at-cell", event=event, cell=Cell(cell))
