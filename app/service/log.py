"""Logging: one line a happening, one line for many of the same kind; no thread waits for where the lines go."""

import atexit
import logging
import os
import queue
import sys
import threading
from dataclasses import dataclass
from logging.handlers import QueueHandler
from typing import TextIO

WINDOW_S = 10.0
MOST = 20  # lines of one kind in a window
DRIVERS = "can"  # python-can's loggers: an adapter that is missing is opened again all day, and says the same each time
DRIVERS_WINDOW_S, DRIVERS_MOST = 3600.0, 1
_MOST_KINDS = 1000
_MOST_WAITING = 1000  # lines; then the newest are left out
_END_S = 2.0


@dataclass(slots=True)
class _Window:
    began_s: float
    lines: int = 0


class RepeatFilter(logging.Filter):
    """Lets MOST lines of one kind through in WINDOW_S; the first one after says how many were left out.

    Of a driver of python-can it is one an hour. A kind is who logs, how grave, and the text before its values.
    """

    def __init__(self) -> None:
        super().__init__()
        self._windows: dict[tuple[str, int, str], _Window] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Tell whether to write the line; one that stands for others says so."""
        kind = (record.name, record.levelno, str(record.msg)[:200])
        is_driver = record.name.partition(".")[0] == DRIVERS
        window_s, most = (DRIVERS_WINDOW_S, DRIVERS_MOST) if is_driver else (WINDOW_S, MOST)
        window = self._windows.get(kind)
        if window is None or not 0 <= record.created - window.began_s < window_s:
            if len(self._windows) >= _MOST_KINDS:
                self._windows.clear()
            self._windows[kind] = _Window(record.created, 1)
            if window is not None and window.lines > most:
                text = record.getMessage()
                record.msg, record.args = f"{text} (and {window.lines - most:,} more of this kind before)", ()
            return True
        window.lines += 1
        return window.lines <= most


class QueuedLines(QueueHandler):
    """Hands lines to a thread that writes them: a full disk, or a terminal that is held, stops nobody else."""

    def __init__(self, stream: TextIO) -> None:
        self._lines: queue.Queue[logging.LogRecord | None] = queue.Queue(_MOST_WAITING)
        super().__init__(self._lines)
        self._stream = stream
        self._left_out = 0
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def enqueue(self, record: logging.LogRecord) -> None:
        """Queue a line; where there is no room it is left out and counted."""
        try:
            self._lines.put_nowait(record)
        except queue.Full:
            self._left_out += 1

    def end(self) -> None:
        """Write what waits, unless that takes long."""
        try:
            self._lines.put(None, timeout=_END_S)
        except queue.Full:
            return
        self._thread.join(_END_S)

    def _write(self) -> None:
        while (record := self._lines.get()) is not None:
            left_out, self._left_out = self._left_out, 0
            more = f" ({left_out:,} lines were left out)" if left_out else ""
            try:
                self._stream.write(f"{record.message}{more}\n")
                self._stream.flush()
            except (OSError, ValueError):  # a full disk, a terminal that is gone, a closed stream
                self._left_out += 1 + left_out


def say(text: str) -> None:
    """Print a line that other programs wait for; where standard output takes none, the service goes on without it."""
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())  # what is still inside would fail again at the end
        os.close(nowhere)


def configure(level: str) -> None:
    """Set up the root logger; called by the command line only."""
    root = logging.getLogger()
    root.setLevel(level.upper())
    if not root.handlers:
        handler = QueuedLines(sys.stderr)
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(name)s: %(message)s", "%H:%M:%S"))
        root.addHandler(handler)
        atexit.register(handler.end)
    for output in root.handlers:
        output.addFilter(RepeatFilter())
    logging.getLogger("can").setLevel(logging.WARNING)
