"""Makes the black boxes of sessions that came from elsewhere, or from before there were any, in a thread of its own."""

from __future__ import annotations

import logging
import threading

from app.analysis.black_box.from_session import has_all_black_boxes, keep_black_boxes
from app.errors import AppError
from app.sessions.black_box_store import BlackBoxStore
from app.sessions.catalogue import Catalogue

log = logging.getLogger(__name__)
_END_S = 10.0


class BlackBoxesOfSessions:
    """Looks once at each finished session of a catalogue."""

    def __init__(
        self, catalogue: Catalogue, store: BlackBoxStore, is_simulated: bool, lost: threading.Event | None = None
    ) -> None:
        """Keep boxes in `store`: of the car's sessions, or of those of the simulated one; all again once `lost`."""
        self._catalogue = catalogue
        self._store = store
        self._is_simulated = is_simulated
        self._lost = lost or threading.Event()
        self._seen: set[str] = set()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._is_closing = False

    def update(self) -> None:
        """Begin to look at what is new, in the background; nothing where that is under way."""
        with self._lock:
            if not self._is_closing and (self._thread is None or not self._thread.is_alive()):
                self._thread = threading.Thread(target=self.read_new, name="black boxes", daemon=True)
                self._thread.start()

    def read_new(self) -> None:
        """Look at what is new; one thread at a time."""
        if self._lost.is_set():
            self._lost.clear()
            self._seen.clear()
        for info in self._catalogue.list():
            if self._is_closing:
                return
            is_ours = (info.metadata.get("source") == "simulator") == self._is_simulated
            if not (info.is_closed and info.events and is_ours) or info.id in self._seen:
                continue
            self._seen.add(info.id)
            try:
                with self._catalogue.open(info.id) as session:
                    if not has_all_black_boxes(session, self._store):
                        keep_black_boxes(session, self._store)
            except AppError as error:
                log.warning("no black boxes of session %s: %s", info.id, error)
            except Exception:  # the sessions after it are looked at all the same
                log.exception("no black boxes of session %s", info.id)

    def close(self) -> None:
        """Stop after the session under way."""
        with self._lock:
            self._is_closing = True
        if self._thread is not None:
            self._thread.join(_END_S)
