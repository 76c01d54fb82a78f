"""What a session is replayed through: its cell file, what its cells had shown before, the cause of its trips."""

from __future__ import annotations

from typing import Protocol

from app.analysis.cell_findings import WatchAlong
from app.analysis.root_cause.cause import trip_cause
from app.analysis.root_cause.from_session import cause_at
from app.analysis.session_cell import cell_of
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.cell_watch import CellWatch
from app.live.pipeline import Pipeline
from app.sessions.reading.reader import SessionFile
from app.sessions.replay import SESSION_CELL, ReplayOptions
from app.sources.loaded_battery import LoadedBattery
from app.telemetry import Source, TripCause


class NewPipeline(Protocol):
    """Makes pipelines; None is the configured filter or cell."""

    def __call__(
        self,
        source: Source,
        serial_url: str | None = None,
        can_url: str | None = None,
        *,
        filter_name: str | None = None,
        cell_name: str | None = None,
        battery: LoadedBattery | None = None,
        cell: CellModel | None = None,
        watch: CellWatch | None = None,
    ) -> Pipeline:
        """Return a fresh pipeline.

        Raises:
            ConfigError: there is no such filter or cell.
        """


class ReplayChain:
    """Makes the pipelines of one session's replay. Without a chosen cell it is the session's, where it keeps one."""

    def __init__(self, session: SessionFile, options: ReplayOptions, new_pipeline: NewPipeline) -> None:
        self._session = session
        self._new_pipeline = new_pipeline
        self._filter_name, self._cell_name = options.filter_name, options.cell_name
        of_then, is_of_then = cell_of(session)
        self._cell: CellModel | None = None
        if is_of_then and self._cell_name in (None, SESSION_CELL):
            self._cell, self._cell_name = of_then, SESSION_CELL
        elif self._cell_name == SESSION_CELL:
            self._cell_name = None
        self._watched = WatchAlong(session, of_then)

    def pipeline(self, from_s: float | None = None) -> Pipeline:
        """Return a fresh pipeline; from a unix time on it knows what the cells had shown until then.

        Raises:
            ConfigError: there is no such filter or cell.
        """
        return self._new_pipeline(
            "replay",
            "recorded",
            "recorded",
            filter_name=self._filter_name,
            cell_name=self._cell_name,
            battery=self._session.loaded_battery,
            cell=self._cell,
            watch=None if from_s is None else self._watched.at(from_s),
        )

    def cause(self, at_s: float) -> TripCause | None:
        """Return what caused the trip that holds at a unix time. From any thread; it takes seconds."""
        with SessionFile(self._session.path, parse=self._session.parse) as session:
            found = cause_at(session, at_s)
        return None if found is None else trip_cause(found)
