"""Publishes what the service knows to an MQTT broker: state as retained messages, events as they happen.

A reader of its own, in a thread of its own: it takes the newest snapshot once a period, and a broker that is slow, gone
or wrong delays nobody. Topics and their contents are described in docs/howto/publish.md.
"""

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import orjson

from app import __version__
from app.battery.battery import Battery
from app.clock import Clock, ClockRun
from app.live.pipeline import Output
from app.service.host import addresses_of
from app.service.mqtt.broker import KEEPALIVE_S, Broker, new_client, parse_broker
from app.service.mqtt.cars import MOST_BYTES
from app.service.settings import Settings
from app.telemetry import Event, Snapshot, Source
from app.telemetry.encoding import aged, encode, is_stale, plain
from app.telemetry.fields import Part
from app.telemetry.service_state import RecordingState
from app.words import Message, Text, rendered

PERIOD_S = 1.0
NAME_CONFLICT_S = 60.0  # how long another service under this name is reported [s]
MAX_EVENTS = 1000  # kept for a broker that is gone; older ones are in the event log
PER_CELL: dict[str, Part] = {
    "voltage_v": "voltage",
    "temperature_degc": "temperature",
    "soc": "voltage",
    "soc_sigma": "voltage",
}
Messages = Iterator[tuple[str, bytes]]


class MqttPublisher:
    """Keeps a connection and publishes; `offer` and `offer_event` return at once, from any thread."""

    def __init__(
        self,
        broker: Broker,
        recording: Callable[[], RecordingState | None],
        clock: Clock,
        *,
        source: Source = "serial",
        about: Mapping[str, object] | None = None,
        segments: Sequence[int] = (),
        period_s: float = PERIOD_S,
    ) -> None:
        """Prepare the connection.

        Args:
            broker: where to publish, with the prefix of this car's topics.
            recording: says what is being recorded.
            clock: of this service.
            source: where values and events come from.
            about: what this car is, for the page of a fleet.
            segments: cells of each pack, by which events name cells.
            period_s: seconds between two messages of a topic.

        Raises:
            ConfigError: paho-mqtt is not installed, or the CA file is none.
        """
        self._broker = broker
        self._recording = recording
        self._clock = clock
        self._source = source
        self._segments = segments
        self._about = None if about is None else encode(dict(about) | car_of(source))
        self._clock_run = ClockRun(clock)
        self._period_s = period_s
        self._snapshot: Snapshot | None = None
        self._last_snapshot: Snapshot | None = None
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._sent: dict[str, bytes] = {}  # since the connection was made
        self._problem: Text | None = Message("mqtt-not-connected")
        self._is_connected = threading.Event()
        self._other_until_s = self._conflict_until_s = -NAME_CONFLICT_S
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)
        client = new_client(broker)
        client.on_connect, client.on_disconnect = self._on_connect, self._on_disconnect
        client.on_connect_fail = self._on_connect_fail
        client.on_message = self._on_own_topic
        client.will_set(self._topic("status"), b"offline", qos=1, retain=True)
        self._client = client

    @property
    def problem(self) -> Message | None:
        """Return why nothing reaches the broker, None while all does."""
        problem = self._problem
        if problem is None and self._clock.monotonic_s() < self._conflict_until_s:
            problem = Message("mqtt-twice")
        return None if problem is None else Message("mqtt", broker=str(self._broker), problem=problem)

    def start(self) -> None:
        """Connect, and again for ever; publish."""
        self._client.connect_async(self._broker.host, self._broker.port, KEEPALIVE_S)
        self._client.loop_start()
        self._thread.start()

    def stop(self) -> None:
        """Say that the service is gone, and close."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)
        if self._is_connected.is_set():
            with contextlib.suppress(ValueError, RuntimeError):
                self._client.publish(self._topic("status"), b"offline", qos=1, retain=True).wait_for_publish(2.0)
        self._client.disconnect()
        self._client.loop_stop()

    def offer(self, snapshot: Snapshot) -> None:
        """Take a snapshot; the newest one is published at the next period."""
        self._snapshot = snapshot

    def on_output(self, output: Output, t_mono_ns: int) -> None:
        """Take the snapshot of what the pipeline made."""
        if output.snapshot is not None:
            self.offer(output.snapshot)

    def offer_event(self, event: Event) -> None:
        """Take an event; it is published as soon as there is a broker."""
        self._events.append(event)

    def _topic(self, name: str) -> str:
        return f"{self._broker.prefix}/{name}"

    def _on_connect(self, _client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            self._problem = str(reason)
            return
        self._sent = {}
        self._problem = None
        self._client.publish(self._topic("status"), b"online", qos=1, retain=True)
        if self._about is not None:
            self._client.publish(self._topic("about"), self._about, qos=1, retain=True)
        self._client.subscribe(self._topic("accumulator"), qos=0)  # to detect another service under this name
        self._is_connected.set()

    def _on_own_topic(self, _client: Any, _data: Any, message: Any) -> None:
        """Another run on this service's own topic, now: a second service has the same name."""
        if message.retain or len(message.payload) > MOST_BYTES:
            return
        try:
            run = orjson.loads(message.payload)["sent"]["run"]
        except (orjson.JSONDecodeError, KeyError, TypeError):
            return
        if run != self._clock_run.id:
            now_s = self._clock.monotonic_s()
            if now_s < self._other_until_s:  # the second one: the first may be the last word of the run before
                self._conflict_until_s = now_s + NAME_CONFLICT_S
            self._other_until_s = now_s + NAME_CONFLICT_S

    def _on_disconnect(self, _client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        self._is_connected.clear()
        if self._problem is None:
            self._problem = Message("mqtt-lost", reason=str(reason))

    def _on_connect_fail(self, _client: Any, _data: Any) -> None:
        self._problem = Message("mqtt-no-broker")

    def _run(self) -> None:
        due = self._clock.monotonic_s()
        while not self._ending.wait(max(0.0, due - self._clock.monotonic_s())):
            due = max(due + self._period_s, self._clock.monotonic_s())
            if not self._is_connected.wait(self._period_s):
                continue
            self._publish_state()
            while self._events and self._is_connected.is_set():  # after the state: there may be many
                self._client.publish(
                    self._topic("events"), event_body(self._events.popleft(), self._source, self._segments), qos=1
                )

    def _publish_state(self) -> None:
        snapshot = self._snapshot
        if snapshot is None or snapshot is self._last_snapshot:
            return
        self._last_snapshot = snapshot
        now_ns = self._clock.monotonic_ns()
        sent = {"run": self._clock_run.id, "s": round(now_ns / 1e9, 3)}
        for name, body in messages(aged(snapshot, now_ns), self._recording(), sent):
            if self._sent.get(name) != body:
                self._sent[name] = body
                self._client.publish(self._topic(name), body, qos=0, retain=True)


def messages(
    snapshot: Snapshot, recording: RecordingState | None, sent: Mapping[str, object] | None = None
) -> Messages:
    """Yield the state's topics and bodies; null is missing. Every object says whether the car is a simulated one.

    `sent` is when, by a clock that never steps: whoever receives it knows by it how long the message was on its way.
    """
    car = car_of(snapshot.source)
    stamp = {"time": round(snapshot.t_wall_ns / 1e9, 3), "source": snapshot.source} | car
    cells, master, ages = plain(snapshot.cells), snapshot.master, plain(snapshot.age_s)
    stale = {part: is_stale(snapshot, part) for part in ages}
    last_known = snapshot.last_known
    last: dict[str, Any] = {} if last_known is None else plain(last_known.cells)
    total = plain(snapshot.accumulator) | {"last_known": None if last_known is None else plain(last_known.accumulator)}
    yield "accumulator", encode(stamp | {"sent": sent, "age_s": ages, "stale": stale} | total)
    for name, part in PER_CELL.items():
        of_cells = {"age_s": ages[part], "stale": stale[part], "values": cells[name], "last_known": last.get(name)}
        yield f"cells/{name}", encode(stamp | of_cells)
    body = {
        "state": master.state,
        "why": rendered(master.why, snapshot.segments),
        "fit": master.fit,
        "flags": master.flags,
    }
    yield "master", encode(body | {"stale": stale["status"]} | car)
    links = {name: {"state": link.state, "lost": link.lost} for name, link in snapshot.links.items()}
    yield "links", encode(links | car)
    yield "alarms", encode([plain(alarm, snapshot.segments) | car for alarm in snapshot.alarms])
    yield "recording", encode(None if recording is None else plain(recording) | car)


def car_of(source: Source) -> dict[str, bool]:
    """Return what every object is marked with: training data must never be taken for the car."""
    return {"simulated": source == "simulator"}


def event_body(event: Event, source: Source, segments: Sequence[int] = ()) -> bytes:
    """An event as JSON; its English text names cells by `segments`."""
    return encode(plain(event, segments) | car_of(source))


def configured_publisher(
    settings: Settings, recording: Callable[[], RecordingState | None], clock: Clock, source: Source, battery: Battery
) -> MqttPublisher | None:
    """Return a publisher to the broker of the settings, None where they name none.

    Raises:
        ConfigError: the broker or the name of the car cannot be used, or paho-mqtt is not installed.
    """
    if settings.mqtt is None:
        return None
    broker = parse_broker(settings.mqtt, settings.mqtt_secret, settings.mqtt_ca).of_car(settings.car)
    about = {
        "url": settings.url or _own_url(settings),
        "battery": battery.name,
        "segments": list(battery.segments),
        "version": __version__,
    }
    return MqttPublisher(broker, recording, clock, source=source, about=about, segments=battery.segments)


def _own_url(settings: Settings) -> str | None:
    """Where the pages of this service are, as far as it knows: a port that was not chosen is not known here."""
    hosts = addresses_of(settings.host) or [settings.host]
    scheme = "https" if settings.has_tls else "http"
    return f"{scheme}://{hosts[0]}:{settings.port}" if settings.port else None
