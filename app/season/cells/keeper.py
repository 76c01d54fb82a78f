"""Keeps a season up to date in a data folder: what is new is read for the passports, then estimated, in a thread."""

from __future__ import annotations

from pathlib import Path

from app.analysis.passport.history import Swap
from app.analysis.passport.keeper import PassportKeeper
from app.estimation.cell_model.circuit import CellModel
from app.season.cells.history import CellHistory, history_of
from app.season.estimates.results import EstimateSet, Results, set_of
from app.season.estimates.session import Job, estimate_session
from app.sessions.catalogue import Catalogue
from app.sessions.info import SessionInfo
from app.sessions.new_sessions import NewSessions
from app.words import naming_cells


class SeasonKeeper(NewSessions):
    """The sessions of one car; answers with what is known so far."""

    def __init__(self, data: Path, catalogue: Catalogue, passports: PassportKeeper, cell: CellModel) -> None:
        """Read nothing yet."""
        super().__init__("season-cells")
        self.catalogue = catalogue
        self.passports = passports
        self.results = Results(data)
        self._cell = cell

    def read_new(self) -> int:
        """Read and estimate every finished session that is not known yet; return how many were estimated."""
        self.passports.read_new()
        own, known = self.own_set(), self.passports.store.known() - self._failed
        new = [
            info
            for info in reversed(self.catalogue.list())
            if info.id in known and not self.results.has(own, info.id, info.size_bytes)
        ]
        if new:
            self.results.begin(own)
        return self._read_each(new, self._estimate)

    def _estimate(self, info: SessionInfo) -> bool:
        (result,) = estimate_session(Job(str(info.path), (None,)))
        self.results.write(self.own_set(), result | {"session_bytes": info.size_bytes})
        return True

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
