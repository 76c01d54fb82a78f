"""A session replayed as a test: the same pipeline, as fast as it goes, against a file of expectations."""

from __future__ import annotations

from collections.abc import Callable

from app.analysis.expectations import Expectations, Raised, Values, Verdict
from app.live.cells import mean
from app.live.pipeline import Output, Pipeline
from app.sessions.info import RecordedConfig
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.recorded_estimates import RecordedEstimates
from app.sessions.replay import item_of, prepare


def prove(
    session: SessionFile,
    expectations: Expectations,
    pipeline: Pipeline,
    on_progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[Verdict]:
    """Replay a session from its start to its end and return what held; the same each time.

    `on_progress` is told how many milliseconds of how many are replayed.
    """
    length_ms = round(1e3 * session.info.duration_s)
    recorded, start_ns = RecordedEstimates(session), session.info.started_mono_ns
    prepare(pipeline, session)
    for received in session.received():
        if isinstance(received, RecordedConfig):
            continue  # the stream carries it too
        output = pipeline.feed(item_of(received))
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
    expectations.values(Values(t_s, snapshot.accumulator, snapshot.cells, None if was is None else mean(was[0])))
