"""Logging: one line a happening, and one line for many of the same kind."""

import logging
from dataclasses import dataclass

WINDOW_S = 10.0
MOST = 20  # lines of one kind in a window
_MOST_KINDS = 1000


@dataclass(slots=True)
class _Window:
    began_s: float
    lines: int = 0


class OfOneKind(logging.Filter):
    """Lets MOST lines of one kind through in WINDOW_S; the first one after says how many were left out.

    A kind is who logs, how grave, and the text before its values are filled in.
    """

    def __init__(self) -> None:
        super().__init__()
        self._windows: dict[tuple[str, int, str], _Window] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Tell whether to write the line; one that stands for others says so."""
        kind = (record.name, record.levelno, str(record.msg)[:200])
        window = self._windows.get(kind)
        if window is None or not 0 <= record.created - window.began_s < WINDOW_S:
            if len(self._windows) >= _MOST_KINDS:
                self._windows.clear()
            self._windows[kind] = _Window(record.created, 1)
            if window is not None and window.lines > MOST:
                text = record.getMessage()
                record.msg, record.args = f"{text} (and {window.lines - MOST:,} more of this kind before)", ()
            return True
        window.lines += 1
        return window.lines <= MOST


def configure(level: str) -> None:
    """Set up the root logger; called by the command line only."""
    logging.basicConfig(
        level=level.upper(), format="%(asctime)s %(levelname)-7s %(name)s: %(message)s", datefmt="%H:%M:%S"
    )
    for handler in logging.getLogger().handlers:
        handler.addFilter(OfOneKind())
    logging.getLogger("can").setLevel(logging.WARNING)
