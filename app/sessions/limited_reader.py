"""Reads sessions for the service: the texts in one are parsed in a process with limits, once for each content."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

from app.errors import NotNow, WorkerEnded
from app.sessions.info import SessionInfo
from app.sessions.reading.session_info import read_info
from app.sessions.worker import DEFINITIONS, JobLimits, Workers
from app.telemetry import Event

A = TypeVar("A")
T = TypeVar("T")
LISTING: Final = JobLimits(5)  # a sound session takes milliseconds
KEPT: Final = 16  # results, and failures


class LimitedReader:
    """Any thread. Our own battery, cell file and recordings need no process."""

    def __init__(
        self,
        workers: Workers,
        own: tuple[object, ...] = (),
    ) -> None:
        """Prepare; no process runs before it is needed.

        Args:
            workers: of the processes.
            own: battery files and cell file of the service itself.
        """
        self._workers = workers
        self._own = own
        self._recorded: set[object] = set()  # ids of this run
        self._lock = threading.Lock()
        self._results: OrderedDict[tuple[object, object], tuple[Any, Exception | None]] = OrderedDict()

    def on_event(self, event: Event) -> None:
        """Take note of the sessions that are recorded here."""
        if event.code in ("recording-started", "recording-split"):
            self._recorded.add(event.message.args["session"])

    def info(self, path: Path) -> SessionInfo:
        """Return what there is to say about a session's file.

        Raises:
            SessionError: it cannot be read.
            LimitExceeded, WorkerEnded: it takes too long, or ends the process.
            NotNow: the processes are busy, or the service ends.
        """
        if path.stem in self._recorded:
            return read_info(path)
        return self._workers.run(LISTING, read_info, path)

    def parse(self, function: Callable[[A], T], text: A) -> T:
        """Return what a function of a module makes of a text, or of files by their names.

        Raises:
            LimitExceeded, WorkerEnded: it takes too much, or ends the process.
            NotNow: the processes are busy, or the service ends.
            Exception: what the function raised.
        """
        if text in self._own:
            return function(text)
        key = (function, tuple(text.items()) if isinstance(text, Mapping) else text)
        with self._lock:
            parsed: tuple[Any, Exception | None] | None = self._results.get(key)
        if parsed is None:
            try:
                parsed = self._workers.run(DEFINITIONS, function, text), None
            except (NotNow, WorkerEnded):  # perhaps not the next time
                raise
            except Exception as error:  # noqa: BLE001  whatever it is, it is raised each time
                parsed = None, error
            with self._lock:
                self._results[key] = parsed
                while len(self._results) > KEPT:
                    self._results.popitem(last=False)
        if parsed[1] is not None:
            raise parsed[1].with_traceback(None)
        result: T = parsed[0]
        return result
