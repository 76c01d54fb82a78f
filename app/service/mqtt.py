"""Publishes what the service knows to an MQTT broker: state as retained messages, events as they happen.

A reader of its own, in a thread of its own: it takes the newest snapshot once a period, and a broker that is slow, gone
or wrong delays nobody. Topics and their contents are described in docs/howto/mqtt.md.
"""

import contextlib
import ssl
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from app.clock import Clock
from app.errors import ConfigError
from app.service.settings import Settings
from app.telemetry import Event, Snapshot, Source
from app.telemetry.aging import aged, is_stale
from app.telemetry.encoding import encode, plain
from app.telemetry.fields import Part
from app.telemetry.service_state import Recording
from app.words import Message, Text, render

PERIOD_S = 1.0
KEEPALIVE_S = 15
RETRY_MIN_S, RETRY_MAX_S = 1, 30
MAX_EVENTS = 1000  # kept for a broker that is gone; older ones are in the event log
PER_CELL: dict[str, Part] = {
    "voltage_v": "voltage",
    "temperature_degc": "temperature",
    "soc": "voltage",
    "soc_sigma": "voltage",
}
DEFAULT_PORTS = {"mqtt": 1883, "mqtts": 8883}
Messages = Iterator[tuple[str, bytes]]


@dataclass(frozen=True, slots=True)
class Broker:
    """Where to publish, and as whom."""

    host: str
    port: int
    prefix: str
    uses_tls: bool
    user: str | None = None
    password: str | None = None
    ca: Path | None = None

    def __str__(self) -> str:
        """For people; without the password."""
        return f"{'mqtts' if self.uses_tls else 'mqtt'}://{self.host}:{self.port}/{self.prefix}"


def parse_broker(url: str, password: str | None = None, ca: Path | None = None) -> Broker:
    """Return the broker of a URL like mqtts://user@host:8883/prefix.

    Raises:
        ConfigError: it is none, or it holds a password, which everybody on the machine could read.
    """
    shape = Message("broker-url")
    parts = urlsplit(url)
    try:
        port = parts.port or DEFAULT_PORTS[parts.scheme]
    except (KeyError, ValueError) as error:
        raise ConfigError("mqtt", url, shape) from error
    if parts.password is not None:
        raise ConfigError("mqtt", Message("hidden"), Message("broker-password", shape=shape))
    prefix = parts.path.strip("/") or "voltwall"
    if not parts.hostname or any(character in url for character in "#+?"):
        raise ConfigError("mqtt", url, shape)
    if ca is not None and not ca.is_file():
        raise ConfigError("mqtt_ca", ca, Message("no-such-file"))
    user = None if parts.username is None else unquote(parts.username)
    return Broker(parts.hostname, port, prefix, parts.scheme == "mqtts", user, password, ca)


class MqttPublisher:
    """Keeps a connection and publishes; `offer` and `offer_event` return at once, from any thread."""

    def __init__(
        self,
        broker: Broker,
        recording: Callable[[], Recording | None],
        clock: Clock,
        *,
        source: Source = "serial",
        period_s: float = PERIOD_S,
    ) -> None:
        """Prepare the connection; `recording` says what is being recorded, `source` where values and events come from.

        Raises:
            ConfigError: paho-mqtt is not installed, or the CA file is none.
        """
        try:
            paho: Any = import_module("paho.mqtt.client")
        except ImportError as error:
            raise ConfigError("mqtt", broker, Message("needs-paho")) from error
        self._broker = broker
        self._recording = recording
        self._clock = clock
        self._source = source
        self._period_s = period_s
        self._snapshot: Snapshot | None = None
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._sent: dict[str, bytes] = {}  # since the connection was made
        self._problem: Text | None = Message("mqtt-not-connected")
        self._is_connected = threading.Event()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)
        client = paho.Client(paho.CallbackAPIVersion.VERSION2)
        client.on_connect, client.on_disconnect = self._on_connect, self._on_disconnect
        client.on_connect_fail = self._on_connect_fail
        client.will_set(self._topic("status"), b"offline", qos=1, retain=True)
        client.reconnect_delay_set(RETRY_MIN_S, RETRY_MAX_S)
        if broker.user is not None:
            client.username_pw_set(broker.user, broker.password)
        if broker.uses_tls:
            try:
                client.tls_set(None if broker.ca is None else str(broker.ca))
            except (ssl.SSLError, OSError) as error:
                raise ConfigError("mqtt_ca", broker.ca, str(error)) from error
        self._client = client

    @property
    def problem(self) -> Message | None:
        """Why nothing reaches the broker, None while all does."""
        return None if self._problem is None else Message("mqtt", broker=str(self._broker), problem=self._problem)

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
        self._is_connected.set()

    def _on_disconnect(self, _client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        self._is_connected.clear()
        if self._problem is None:
            self._problem = Message("mqtt-lost", reason=str(reason))

    def _on_connect_fail(self, _client: Any, _data: Any) -> None:
        self._problem = Message("mqtt-no-broker")

    def _run(self) -> None:
        shown: Snapshot | None = None
        due = self._clock.monotonic_s()
        while not self._ending.wait(max(0.0, due - self._clock.monotonic_s())):
            due = max(due + self._period_s, self._clock.monotonic_s())
            if not self._is_connected.wait(self._period_s):
                continue
            while self._events:
                self._client.publish(self._topic("events"), event_body(self._events.popleft(), self._source), qos=1)
            snapshot = self._snapshot
            if snapshot is None or snapshot is shown:
                continue
            shown = snapshot
            for name, body in messages(aged(snapshot, self._clock.monotonic_ns()), self._recording()):
                if self._sent.get(name) != body:
                    self._sent[name] = body
                    self._client.publish(self._topic(name), body, qos=0, retain=True)


def messages(snapshot: Snapshot, recording: Recording | None) -> Messages:
    """Yield the state's topics and bodies; null is missing. Every object says whether the car is a simulated one."""
    car = car_of(snapshot.source)
    stamp = {"time": round(snapshot.t_wall_ns / 1e9, 3), "source": snapshot.source} | car
    cells, master, ages = plain(snapshot.cells), snapshot.master, plain(snapshot.age_s)
    stale = {part: is_stale(snapshot, part) for part in ages}
    yield "accumulator", encode(stamp | {"age_s": ages, "stale": stale} | plain(snapshot.accumulator))
    for name, part in PER_CELL.items():
        yield f"cells/{name}", encode(stamp | {"age_s": ages[part], "stale": stale[part], "values": cells[name]})
    said = {"state": master.state, "why": render(master.why), "fit": master.fit, "flags": master.flags}
    yield "master", encode(said | {"stale": stale["status"]} | car)
    links = {name: {"state": link.state, "lost": link.lost} for name, link in snapshot.links.items()}
    yield "links", encode(links | car)
    yield "alarms", encode([plain(alarm) | car for alarm in snapshot.alarms])
    yield "recording", encode(None if recording is None else plain(recording) | car)


def car_of(source: Source) -> dict[str, bool]:
    """Return what every object is marked with: training data must never be taken for the car."""
    return {"simulated": source == "simulator"}


def event_body(event: Event, source: Source) -> bytes:
    """An event as JSON."""
    return encode(plain(event) | car_of(source))


def configured_publisher(
    settings: Settings, recording: Callable[[], Recording | None], clock: Clock, source: Source
) -> MqttPublisher | None:
    """Return a publisher to the broker of the settings, None where they name none.

    Raises:
        ConfigError: the broker cannot be used, or paho-mqtt is not installed.
    """
    if settings.mqtt is None:
        return None
    password = None if settings.mqtt_password is None else settings.mqtt_password.get_secret_value()
    broker = parse_broker(settings.mqtt, password, settings.mqtt_ca)
    return MqttPublisher(broker, recording, clock, source=source)
