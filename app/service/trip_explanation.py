"""The cause of a trip: searched in the running recording, shown by the alarm, kept as an event."""

from collections.abc import Sequence

from app.analysis.black_box.box import BlackBox
from app.analysis.incidents import Trigger
from app.analysis.root_cause.from_session import make_verdict
from app.analysis.root_cause.judge import Cause, trip_cause
from app.clock import Clock
from app.estimation.cell_model.circuit import CellModel
from app.live.pipeline import Pipeline
from app.service.events import Events
from app.sessions.catalogue import Catalogue
from app.sessions.recording.auto_recorder import AutoRecorder
from app.telemetry import Event
from app.words import Message


class TripExplanation:
    """The cause for a black box and the events after it; called in the thread that writes black boxes."""

    def __init__(
        self,
        recorder: AutoRecorder,
        catalogue: Catalogue,
        pipeline: Pipeline,
        cell: CellModel,
        events: Events,
        clock: Clock,
    ) -> None:
        self._recorder = recorder
        self._catalogue = catalogue
        self._pipeline = pipeline
        self._cell = cell
        self._events = events
        self._clock = clock

    def cause(self, session_id: str, group: Sequence[Trigger]) -> Cause | None:
        """Judge an incident by what is on the disk of the recording that runs, and keep the verdict with it.

        Raises:
            AppError: it cannot be written or read.
        """
        self._recorder.flush()
        with self._catalogue.open(session_id) as session:
            return make_verdict(session, group, self._cell, self._clock.wall_ns())

    def on_black_box(self, box: BlackBox) -> None:
        """Note that there is a black box, and of a trip its cause, which the alarm then shows; also where it is new."""
        what, cause = box.message.message, box.cause
        is_revision = cause is not None and cause.revised
        if not is_revision:
            made = Message("black-box", what=what) if box.is_complete else Message("black-box-incomplete", what=what)
            self._events.add(Event(self._clock.wall_ns(), "info", "blackbox", made, cell=box.cell))
        if cause is not None and box.severity == "trip":
            why = cause.message.message
            message = Message("trip-cause-revised", cause=why) if is_revision else Message("trip-cause", cause=why)
            self._events.add(Event(self._clock.wall_ns(), "info", "trip-cause", message, cell=cause.cell))
            self._pipeline.explain(trip_cause(cause), round(box.at * 1e9))
