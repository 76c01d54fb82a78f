"""Reads finished sessions that are new, once each, one after another, in a thread of its own."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence

from app.estimation.errors import EstimatorError
from app.sessions.errors import SessionError
from app.sessions.info import SessionInfo
from app.words import named_as_here

log = logging.getLogger(__name__)


class NewSessions:
    """Base of what is kept up to date with the sessions of a catalogue: `read_new` says which are new."""

    def __init__(self, what: str) -> None:
        """Read nothing yet; `what` names the thread, and stands in the log."""
        self._what = what
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._progress = (0, 0)
        self._failed: set[str] = set()
        self._is_closing = False

    @property
    def progress(self) -> tuple[int, int]:
        """Sessions read and to be read, of the run that is under way; (0, 0) without one."""
        return self._progress

    def read_new(self) -> int:
        """Read every session that is new; return how many."""
        raise NotImplementedError

    def update(self) -> None:
        """Begin to read what is new, in the background; nothing where there is none, or that is under way already."""
        with self._lock:
            if self._is_closing or (self._thread is not None and self._thread.is_alive()):
                return
            if self._is_worth_it():
                self._thread = threading.Thread(target=named_as_here(self.read_new), name=self._what, daemon=True)
                self._thread.start()

    def _is_worth_it(self) -> bool:
        """Whether there is something to read, where that is known without reading much."""
        return True

    def _read_each(self, new: Sequence[SessionInfo], read: Callable[[SessionInfo], bool]) -> int:
        """Return how many of them `read` said that it took; one that cannot be read is not tried again."""
        done = 0
        for k, info in enumerate(new):
            if self._is_closing:
                break
            self._progress = (k, len(new))
            try:
                done += read(info)
            except Exception as error:  # the sessions after it are read all the same
                self._failed.add(info.id)
                expected = isinstance(error, (SessionError, EstimatorError, OSError))
                log.warning("%s: session %s: %s", self._what, info.id, error, exc_info=None if expected else error)
        self._progress = (0, 0)
        return done

    def close(self) -> None:
        """Stop reading."""
        with self._lock:
            self._is_closing = True
            thread = self._thread
        if thread is not None:
            thread.join(timeout=10.0)
