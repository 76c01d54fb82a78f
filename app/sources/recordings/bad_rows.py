"""Rows and frames of a file that cannot be read: counted, the first ones named; many of them are a refusal."""

from dataclasses import dataclass, field

from app.errors import ImportFailed
from app.words import Message

SHOWN = 10
WARNED_SHARE, REFUSED_SHARE = 0.05, 0.5
EARLY = 1000  # so many bad ones without one good one are enough
_TEXT = 60  # characters


@dataclass(slots=True)
class BadRows:
    """What could not be read of a file; fed while it is read."""

    what: str = "frames"
    count: int = 0
    first: list[tuple[int | None, str]] = field(default_factory=list)  # line, where the file has such, and reason

    def add(self, line: int | None, reason: str) -> None:
        """Count a row that cannot be read."""
        self.count += 1
        if len(self.first) < SHOWN:
            self.first.append((line, reason.strip()[:_TEXT]))

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

    def notes(self, good: int) -> list[str]:
        """Return what to tell the user, in no line where everything was read."""
        if not self.count:
            return []
        warning = "warning: " if self.count > WARNED_SHARE * (self.count + good) else ""
        text = f"{warning}{self.count} of {self.count + good} {self.what} cannot be read and are left out"
        return [f"{text}: {self.summary()}"]

    def summary(self) -> str:
        """Return the first of them, with line and reason."""
        named = [reason if line is None else f"line {line}: {reason}" for line, reason in self.first]
        return "; ".join([*named, "..."] if self.count > len(named) else named)
