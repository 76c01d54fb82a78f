"""Replay of a session, also as a test: as fast as it goes, against a file of expectations."""

from __future__ import annotations

from collections.abc import Callable

from app.analysis.expectations import ExpectationResult, Expectations, Raised, SnapshotValues
from app.analysis.root_cause.from_session import cause_at
from app.analysis.root_cause.judge import trip_cause
from app.analysis.session_cell import cell_of
from app.analysis.session_judge import WatchAlong
from app.estimation.cell_model.circuit import CellModel
from app.live.cells import mean
from app.live.pipeline import Output, Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.sessions.info import RecordedConfig
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.recorded_estimates import RecordedEstimates
from app.sessions.replay import SESSION_CELL, NewPipeline, ReplayOptions, item_of, prepare
from app.telemetry import TripCause


def cell_for(session: SessionFile, chosen: str | None) -> tuple[str | None, CellModel | None]:
    """Return name and model of the cell that recomputes a session's estimates.

    It is the recorded one, unless another is chosen; (name, None) is a cell of this name, (None, None) today's.
    """
    if chosen in (None, SESSION_CELL):
        recorded, is_recorded = cell_of(session)
        return (SESSION_CELL, recorded) if is_recorded else (None, None)
    return chosen, None


def pipelines_of(factory: PipelineFactory, session: SessionFile, options: ReplayOptions) -> NewPipeline:
    """Return what makes the pipelines of one session's replay.

    Raises:
        ConfigError: there is no such filter or cell.
    """
    name, cell = cell_for(session, options.cell_name)
    chosen = factory.chosen(options.filter_name, name, session.loaded_battery, cell)
    watched = WatchAlong(session, cell_of(session)[0])

    def pipeline(from_s: float | None) -> Pipeline:
        watch = None if from_s is None else watched.at(from_s)
        return chosen.pipeline("replay", "recorded", "recorded", watch=watch)

    return pipeline


def cause_of_trip_at(session: SessionFile, at_s: float) -> TripCause | None:
    """Return what caused the trip that holds at a unix time; it takes seconds."""
    cause = cause_at(session, at_s)
    return None if cause is None else trip_cause(cause)


def prove(
    session: SessionFile,
    expectations: Expectations,
    pipeline: Pipeline,
    on_progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[ExpectationResult]:
    """Replay a session from its start to its end and return what held; the same each time.

    `on_progress` gets the milliseconds replayed and their total.
    """
    length_ms = round(1e3 * session.info.duration_s)
    recorded, start_ns = RecordedEstimates(session), session.info.started_mono_ns
    prepare(pipeline, session)
    for received in session.received():
        if isinstance(received, RecordedConfig):
            continue  # the stream carries it too
        output = pipeline.feed(item_of(received, session.loaded_battery))
        pipeline.predict()
        on_progress((received.t_mono_ns - start_ns) // 1_000_000, length_ms)
        _tell(expectations, output, (received.t_mono_ns - start_ns) / 1e9, recorded)
    return expectations.verdicts()


def _tell(expectations: Expectations, output: Output, t_s: float, recorded: RecordedEstimates) -> None:
    for event in output.events:
        if event.severity != "info":
            expectations.alarm(Raised(t_s, event.code, event.severity, event.cell))
    snapshot = output.snapshot
    if snapshot is None:
        return
    was = recorded.at(snapshot.t_mono_ns)
    expectations.values(
        SnapshotValues(t_s, snapshot.accumulator, snapshot.cells, None if was is None else mean(was[0]))
    )
