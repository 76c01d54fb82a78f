"""The part of a snapshot that is the service's, not the battery's."""

from app.clock import ClockRun
from app.service.events import Events
from app.service.master import ConfigurationInForce
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.replay import ReplayPlayer
from app.telemetry.service_state import RecordingState, ServiceState


def recording_state(recorder: AutoRecorder) -> RecordingState | None:
    """Return the session being recorded; None without one."""
    session = recorder.session
    if session is None:
        return None
    return RecordingState(session.id, session.started_wall_ns, session.frames, session.size_bytes)


class ServiceStateReader:
    """Asks the parts."""

    def __init__(
        self,
        recorder: AutoRecorder,
        replay: ReplayPlayer,
        events: Events,
        configuration: ConfigurationInForce,
        run: ClockRun,
    ) -> None:
        self._recorder = recorder
        self._replay = replay
        self._events = events
        self._configuration = configuration
        self._run = run

    def at(self, now_ns: int) -> ServiceState:
        """Return recording, replay, the newest event's id, and the hash of the stored configuration.

        Args:
            now_ns: monotonic clock at which the ages of the snapshot are counted; a second reading of the clock here
                would call them younger than they are wherever the process stood between the two.
        """
        return ServiceState(
            recording=recording_state(self._recorder),
            replay=self._replay.state(),
            last_event_id=self._events.store.last_id,
            config_stored_hash=self._configuration.stored_hash(),
            sent_s=now_ns / 1e9,
            run=self._run.id,
            not_recording=self._recorder.stall,
        )
