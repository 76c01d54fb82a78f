"""Files of the data folder that were set aside: an event each, and a problem of health until the next start."""

from collections.abc import Callable
from pathlib import Path

from app.sources.data_file import encodable
from app.telemetry import Severity
from app.words import Message

Note = Callable[[Severity, str, Message], None]


class DamagedFiles:
    """Any thread; the event log itself may be one of them, so events wait until there is one."""

    def __init__(self) -> None:
        self.problems: list[Message] = []
        self._note: Note | None = None

    def add(self, path: Path, kept: Path) -> None:
        """Note that a file was renamed to `kept`."""
        message = Message("file-set-aside", file=encodable(path.name), kept=encodable(kept.name))
        self.problems.append(message)
        if self._note is not None:
            self._note("warning", "file-set-aside", message)

    def note_into(self, note: Note) -> None:
        """Note what there is, and from now on everything."""
        self._note = note
        for message in self.problems:
            note("warning", "file-set-aside", message)
