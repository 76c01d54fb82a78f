"""Events of the service: into the event log, onto the console, and to whoever subscribed."""

from collections.abc import Callable

from app.clock import Clock
from app.live.pipeline import Output
from app.sessions.event_log import EventLog
from app.telemetry import Event, Severity
from app.words import Message


class Events:
    """Takes events from any thread."""

    def __init__(self, store: EventLog, clock: Clock) -> None:
        self.store = store
        self._clock = clock
        self._uptime_ms: int | None = None
        self._subscribers: list[Callable[[Event], None]] = []

    def subscribe(self, subscriber: Callable[[Event], None]) -> None:
        """Call `subscriber` with every event from now on, after it was logged."""
        self._subscribers.append(subscriber)

    def add(self, event: Event) -> None:
        """Log an event and pass it on."""
        self.store.append(event, self._uptime_ms)
        for subscriber in self._subscribers:
            subscriber(event)

    def note(self, severity: Severity, code: str, message: Message, who: str | None = None) -> None:
        """Log something that the service or a user did."""
        self.add(Event(self._clock.wall_ns(), severity, code, message, who=who))

    def on_output(self, output: Output, t_mono_ns: int) -> None:
        """Log what the pipeline found; events carry the master's uptime while RS232 is live."""
        for event in output.events:
            self.add(event)
        if (snapshot := output.snapshot) is not None:
            is_known = snapshot.uptime_s is not None and snapshot.links.rs232.state == "live"
            self._uptime_ms = round((snapshot.uptime_s or 0.0) * 1000) if is_known else None
