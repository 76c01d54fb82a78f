"""Receives all cars of a broker: what the page of the fleet shows."""

import threading
from typing import Any

from app.clock import Clock
from app.service.mqtt.broker import CAR_NAME, KEEPALIVE_S, Broker, limited_to, new_client
from app.service.mqtt.cars import MOST_BYTES, MOST_KEPT_BYTES, TOPICS, Car
from app.words import Message, Text

MOST_CARS = 5000
MOST_PACKET_BYTES = 1 << 20  # the broker delivers none that is larger


class Fleet:
    """Subscribes to PREFIX/CAR/... and keeps the newest of every car; any thread reads."""

    def __init__(self, broker: Broker, clock: Clock) -> None:
        """Prepare the connection.

        Raises:
            ConfigError: paho-mqtt is not installed, or the CA file is none.
        """
        self._broker = broker
        self._clock = clock
        self._cars: dict[str, Car] = {}
        self._lock = threading.Lock()
        self._problem: Text | None = Message("mqtt-not-connected")
        self._kept_bytes = 0
        self.messages = 0
        self.left_out = 0  # messages beyond a limit
        client = new_client(broker, is_version_5=True)
        client.on_connect, client.on_disconnect = self._on_connect, self._on_disconnect
        client.on_connect_fail = self._on_connect_fail
        client.on_message = self._on_message
        self._client = client

    @property
    def broker(self) -> str:
        """Return the broker's address, for people."""
        return str(self._broker)

    @property
    def problem(self) -> Message | None:
        """Return why no car is received, None while the broker answers."""
        return None if self._problem is None else Message("mqtt", broker=str(self._broker), problem=self._problem)

    @property
    def notice(self) -> Message | None:
        """Return the message about members of the broker beyond the limits; None for none."""
        if not self.left_out:
            return None
        most_kb, all_mb = MOST_BYTES >> 10, MOST_KEPT_BYTES >> 20
        return Message("fleet-left-out", n=self.left_out, message=most_kb, total=all_mb, cars=MOST_CARS)

    def start(self) -> None:
        """Connect, and again for ever."""
        limit = limited_to(MOST_PACKET_BYTES)
        self._client.connect_async(self._broker.host, self._broker.port, KEEPALIVE_S, properties=limit)
        self._client.loop_start()

    def stop(self) -> None:
        """Close the connection."""
        self._client.disconnect()
        self._client.loop_stop()

    def cars(self) -> list[dict[str, Any]]:
        """Return every car by name, as it is now."""
        now_s, wall_s = self._clock.monotonic_s(), self._clock.wall_ns() / 1e9
        with self._lock:
            return [self._cars[name].shown(now_s, wall_s) for name in sorted(self._cars)]

    def _on_connect(self, client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            self._problem = str(reason)
            return
        self._problem = None
        client.subscribe([(f"{self._broker.prefix}/+/{topic}", 1) for topic in sorted(TOPICS)])

    def _on_disconnect(self, _client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if self._problem is None:
            self._problem = Message("mqtt-lost", reason=str(reason))

    def _on_connect_fail(self, _client: Any, _data: Any) -> None:
        self._problem = Message("mqtt-no-broker")

    def _on_message(self, _client: Any, _data: Any, message: Any) -> None:
        name, _, topic = message.topic[len(self._broker.prefix) + 1 :].rpartition("/")
        if topic not in TOPICS or not CAR_NAME.fullmatch(name):
            return
        now_s = self._clock.monotonic_s()
        with self._lock:
            car = self._cars.get(name)
            if car is None:
                if len(self._cars) >= MOST_CARS:
                    self.left_out += 1
                    return
                car = self._cars[name] = Car(name)
            self.messages += 1
            room, before = MOST_KEPT_BYTES - self._kept_bytes, car.kept_bytes
            if not car.take(topic, message.payload, now_s, is_retained=message.retain, room_bytes=room):
                self.left_out += 1
            self._kept_bytes += car.kept_bytes - before
