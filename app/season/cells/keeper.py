"""Keeps a season up to date in a data folder: what is new is read for the passports, then estimated, in a thread."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

from app.analysis.passport.history import Swap
from app.analysis.passport.keeper import PassportKeeper
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.season.cells.history import CellHistory, history_of
from app.season.estimates.results import EstimateSet, Results, set_of
from app.season.estimates.session import Job, estimate_session
from app.sessions.catalogue import Catalogue
from app.sessions.errors import SessionError
from app.words import naming_cells

log = logging.getLogger(__name__)


class SeasonKeeper:
    """The sessions of one car; answers with what is known so far."""

    def __init__(self, data: Path, catalogue: Catalogue, passports: PassportKeeper, cell: CellModel) -> None:
        """Read nothing yet."""
        self.catalogue = catalogue
        self.passports = passports
        self.results = Results(data)
        self._cell = cell
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._progress = (0, 0)
        self._failed: set[str] = set()
        self._is_closing = False

    @property
    def progress(self) -> tuple[int, int]:
        """Sessions done and to be done, of the run that is under way; (0, 0) without one."""
        return self._progress

    def update(self) -> None:
        """Begin with what is new, in the background; nothing where there is none, or that is under way already."""
        with self._lock:
            if self._is_closing or (self._thread is not None and self._thread.is_alive()):
                return
            self._thread = threading.Thread(target=self.read_new, name="season-cells", daemon=True)
            self._thread.start()

    def read_new(self) -> None:
        """Read and estimate every finished session that is not known yet."""
        self.passports.read_new()
        own = self.own_set()
        known = self.passports.store.known()
        new = [
            info
            for info in reversed(self.catalogue.list())
            if info.id in known and info.id not in self._failed and not self.results.has(own, info.id, info.size_bytes)
        ]
        if new:
            self.results.begin(own)
        for k, info in enumerate(new):
            if self._is_closing:
                break
            self._progress = (k, len(new))
            try:
                (result,) = estimate_session(Job(str(info.path), (None,)))
                self.results.write(own, result | {"session_bytes": info.size_bytes})
            except (SessionError, EstimatorError, OSError) as error:
                self._failed.add(info.id)
                log.warning("session %s is not in the season: %s", info.id, error)
            except Exception:  # the sessions after it are read all the same
                self._failed.add(info.id)
                log.exception("session %s is not in the season", info.id)
        self._progress = (0, 0)

    def own_set(self) -> EstimateSet:
        """Return the set of results by each session's own cell file."""
        return set_of("session", None, "fused")

    def history(self) -> CellHistory:
        """Return the measurements of every cell."""
        keeper = self.passports
        with naming_cells(keeper.battery.segments):
            return history_of(
                keeper.records(),
                [Swap(swap.time_s, tuple(swap.cells), swap.note) for swap in keeper.store.swaps()],
                {result["session"]: result for result in self.results.read_all(self.own_set())},
                self._cell,
                keeper.battery.n_cells,
            )

    def close(self) -> None:
        """Stop."""
        with self._lock:
            self._is_closing = True
            thread = self._thread
        if thread is not None:
            thread.join(timeout=10.0)
