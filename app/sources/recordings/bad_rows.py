"""Rows and frames of a file that cannot be read: counted, the first ones named; many of them are a refusal."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from app.errors import ImportFailed
from app.words import Message, Text

SHOWN = 10
WARNED_SHARE, REFUSED_SHARE = 0.05, 0.5
EARLY = 1000  # so many bad ones without one good one are enough
SHOWN_TEXT = 60  # characters
NAMED = 12  # columns of a file that has others than those asked for


class UnreadableLine(ValueError):
    """A line that is none of its format: `why` is what to tell of it."""

    def __init__(self, why: Message) -> None:
        self.why = why
        super().__init__(why.code)


@dataclass(slots=True)
class BadRows:
    """The rows of a file that could not be read; fed while it is read."""

    what: Message = field(default_factory=lambda: Message("frames"))
    count: int = 0
    first: list[tuple[int | None, Text]] = field(default_factory=list)  # line, where the file has such, and reason

    def add(self, line: int | None, reason: Text) -> None:
        """Count a row that cannot be read."""
        self.count += 1
        if len(self.first) < SHOWN:
            self.first.append((line, reason.strip()[:SHOWN_TEXT] if isinstance(reason, str) else reason))

    def check(self, source: str, good: int) -> None:
        """Refuse a file of which more than half cannot be read.

        Raises:
            ImportFailed: it is so; names the first of them.
        """
        if self.count <= REFUSED_SHARE * (self.count + good):
            return
        raise ImportFailed(
            source,
            Message("too-many-bad", bad=self.count, rows=self.count + good, what=self.what, first=self.summary()),
        )

    def notes(self, good: int) -> list[Message]:
        """Return what to tell the user, nothing where everything was read."""
        if not self.count:
            return []
        rows = self.count + good
        note = Message("some-bad", bad=self.count, rows=rows, what=self.what, first=self.summary())
        return [self.warned(note, rows)]

    def warned(self, note: Message, rows: int) -> Message:
        """Return the note as a warning where more than a few of the file's rows cannot be read."""
        return Message("note-warning", note=note) if self.count > WARNED_SHARE * rows else note

    def summary(self) -> Text:
        """Return the first of them, with line and reason."""
        named = [
            reason if line is None else Message("at-line", line=line, reason=reason) for line, reason in self.first
        ]
        text: Text = ""
        for name in [*named, "..."] if self.count > len(named) else named:
            text = Message("joined", first=text, then=name) if text else name
        return text


def some_of(names: Sequence[str]) -> Message:
    """Return the first names of many, and how many more there are."""
    shown = tuple(repr(name) for name in names[:NAMED])
    more = len(names) - NAMED
    return Message("and-more", shown=shown, n=more) if more > 0 else Message("list", shown=shown)
