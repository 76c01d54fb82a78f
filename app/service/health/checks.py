"""Health checks of the service."""

from collections.abc import Callable
from pathlib import Path

from app.clock import Clock
from app.live.load_shedding import LoadShedding
from app.service.events import Events
from app.service.links import ServiceLinks
from app.service.mqtt.publisher import MqttPublisher
from app.service.pipeline_thread import PipelineThread
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sources.data_file import encodable
from app.telemetry import Severity
from app.telemetry.events import link_trouble
from app.words import Message

Note = Callable[[Severity, str, Message], None]


class DamagedFiles:
    """Any thread; the event log itself may be one of them, so events wait until there is one."""

    def __init__(self) -> None:
        self.problems: list[Message] = []
        self._note: Note | None = None

    def add(self, path: Path, kept: Path) -> None:
        """Note that a file was renamed to `kept`."""
        message = Message("file-set-aside", file=encodable(path.name), kept=encodable(kept.name))
        self.problems.append(message)
        if self._note is not None:
            self._note("warning", "file-set-aside", message)

    def note_into(self, note: Note) -> None:
        """Note what there is, and from now on everything."""
        self._note = note
        for message in self.problems:
            note("warning", "file-set-aside", message)


class Health:
    """Asks every part that can fail.

    Three questions, each stricter than the next: is anything missing (`problems`), does nothing come from the battery
    or go to the disk (`failures`), and does a part stand still that only a restart brings back (`stalls`)?
    """

    def __init__(
        self,
        live: PipelineThread,
        links: ServiceLinks,
        recorder: AutoRecorder,
        events: Events,
        mqtt: MqttPublisher | None,
        clock: Clock,
        load: LoadShedding,
        damaged: DamagedFiles,
    ) -> None:
        self._damaged = damaged
        self._load = load
        self._live = live
        self._links = links
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
        mqtt = None if self._mqtt is None else self._mqtt.problem
        others = [self._recorder.status.warning, self._events.store.error, mqtt, self._load.problem]
        return _once([*self._live.problems(), *self.failures(), *others, *self._damaged.problems])

    def failures(self) -> list[Message]:
        """Return why nothing is shown or recorded: links, recorder, pipeline. A master that is switched off is one."""
        snapshot = self._live.snapshot
        links = [] if snapshot is None else [link_trouble(name, status) for name, status in snapshot.links.items()]
        messages = [
            *self._live.silence(),
            *self.stalls(),
            *links,
            self._recorder.status.error,
            self._recorder.start_failure,
        ]
        return _once(messages)

    def stalls(self) -> list[Message]:
        """Return what stands still for good: threads of pipeline, links, recorder.

        Nothing that waits for the car, nor for the disk: a restart would lose what waits in memory, and show nothing.
        """
        return [*self._live.stuck(), *self._links.stuck(), *self._recorder.stuck()]


def _once(messages: list[Message | None]) -> list[Message]:
    """Each message once, and the pipeline's silence, whose seconds go on between two readings, once."""
    message_by_code = {
        message.code if message.code == "no-snapshot-for" else message: message for message in messages[::-1] if message
    }
    return [*message_by_code.values()][::-1]
