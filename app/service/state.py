"""What a snapshot is sent with that is the service's, not the battery's."""

from typing import Any

from app.service.configuration import ConfigurationInForce
from app.service.events import Events
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.replay import Replaying


def recording_state(recorder: AutoRecorder) -> dict[str, Any] | None:
    """Return the session being recorded; None without one."""
    session = recorder.session
    if session is None:
        return None
    return {
        "session_id": session.id,
        "since": session.started_wall_ns / 1e9,
        "frames": session.frames,
        "bytes": session.size_bytes,
    }


class ServiceState:
    """Asks the parts."""

    def __init__(
        self, recorder: AutoRecorder, replay: Replaying, events: Events, configuration: ConfigurationInForce
    ) -> None:
        self._recorder = recorder
        self._replay = replay
        self._events = events
        self._configuration = configuration

    def now(self) -> dict[str, Any]:
        """Return recording, replay, the newest event's id, and the hash of the stored configuration."""
        return {
            "recording": recording_state(self._recorder),
            "replay": self._replay.state(),
            "last_event_id": self._events.store.last_id,
            "config_stored_hash": self._configuration.stored_hash(),
        }
