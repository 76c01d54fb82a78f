"""Whether the service does its work."""

from app.clock import Clock
from app.service.events import Events
from app.service.mqtt.publisher import MqttPublisher
from app.service.pipeline_thread import PipelineThread
from app.sessions.recording.auto_recorder import AutoRecorder
from app.telemetry.link_messages import link_trouble
from app.words import Message


class Health:
    """Asks every part that can fail."""

    def __init__(
        self, live: PipelineThread, recorder: AutoRecorder, events: Events, mqtt: MqttPublisher | None, clock: Clock
    ) -> None:
        self._live = live
        self._recorder = recorder
        self._events = events
        self._mqtt = mqtt
        self._clock = clock
        self._started_s = clock.monotonic_s()

    @property
    def uptime_s(self) -> float:
        """Seconds since the service was made."""
        return self._clock.monotonic_s() - self._started_s

    def problems(self) -> list[Message]:
        """Return what is missing; empty while all is well."""
        problems, snapshot = self._live.problems(), self._live.snapshot
        if snapshot is None:
            return problems
        links = [link_trouble(name, status) for name, status in snapshot.links.items()]
        recorder = self._recorder.status
        mqtt = None if self._mqtt is None else self._mqtt.problem
        others = [*links, recorder.error or recorder.warning, self._events.store.error, mqtt]
        return problems + [problem for problem in others if problem is not None]
