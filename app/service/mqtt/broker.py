"""The broker of a URL, and a client of it with its password and TLS."""

import re
import ssl
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from app.errors import ConfigError
from app.words import Message

KEEPALIVE_S = 15
RETRY_MIN_S, RETRY_MAX_S = 1, 3  # a radio may be there for seconds only
CONNECT_S = 10.0  # to be answered: over a radio a way may take seconds, and be gone twice
DEFAULT_PORTS = {"mqtt": 1883, "mqtts": 8883}
CAR_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,39}")


@dataclass(frozen=True, slots=True)
class Broker:
    """A broker, the prefix of all topics, and as whom to log in."""

    host: str
    port: int
    prefix: str
    uses_tls: bool
    user: str | None = None
    password: str | None = None
    ca: Path | None = None

    def __str__(self) -> str:
        """Return the address without the password."""
        return f"{'mqtts' if self.uses_tls else 'mqtt'}://{self.host}:{self.port}/{self.prefix}"

    def of_car(self, car: str | None) -> "Broker":
        """The same broker with the topics of one car of several.

        Raises:
            ConfigError: no car can be called so: its name is a level of a topic.
        """
        if car is None:
            return self
        if not CAR_NAME.fullmatch(car):
            raise ConfigError("car", car, Message("car-name"))
        return replace(self, prefix=f"{self.prefix}/{car}")


def parse_broker(url: str, password: str | None = None, ca: Path | None = None, *, field: str = "mqtt") -> Broker:
    """Return the broker of a URL like mqtts://user@host:8883/prefix; `field` is the setting that it came from.

    Raises:
        ConfigError: it is none, or it holds a password, which everybody on the machine could read.
    """
    shape = Message("broker-url")
    parts = urlsplit(url)
    try:
        port = parts.port or DEFAULT_PORTS[parts.scheme]
    except (KeyError, ValueError) as error:
        raise ConfigError(field, url, shape) from error
    if parts.password is not None:
        raise ConfigError(field, Message("hidden"), Message("broker-password", shape=shape))
    prefix = parts.path.strip("/") or "voltwall"
    if not parts.hostname or any(character in url for character in "#+?"):
        raise ConfigError(field, url, shape)
    if ca is not None and not ca.is_file():
        raise ConfigError("mqtt_ca", ca, Message("no-such-file"))
    user = None if parts.username is None else unquote(parts.username)
    return Broker(parts.hostname, port, prefix, parts.scheme == "mqtts", user, password, ca)


def new_client(broker: Broker, *, is_version_5: bool = False) -> Any:
    """Return a paho client that logs in as the broker wants it and connects again for ever; it is not connected.

    Args:
        broker: where it connects.
        is_version_5: use MQTT 5, where a client can limit what it is sent, see `limited_to`.

    Raises:
        ConfigError: paho-mqtt is not installed, or the CA file is none.
    """
    try:
        paho: Any = import_module("paho.mqtt.client")
    except ImportError as error:
        raise ConfigError("mqtt", str(broker), Message("needs-paho")) from error
    version = paho.MQTTv5 if is_version_5 else paho.MQTTv311
    client = paho.Client(paho.CallbackAPIVersion.VERSION2, protocol=version)
    client.reconnect_delay_set(RETRY_MIN_S, RETRY_MAX_S)
    client.connect_timeout = CONNECT_S
    if broker.user is not None:
        client.username_pw_set(broker.user, broker.password)
    if broker.uses_tls:
        try:
            client.tls_set(None if broker.ca is None else str(broker.ca))
        except (ssl.SSLError, OSError) as error:
            raise ConfigError("mqtt_ca", broker.ca, str(error)) from error
    return client


def limited_to(packet_bytes: int) -> Any:
    """Return properties of an MQTT 5 connection over which the broker sends no larger packet."""
    properties = import_module("paho.mqtt.properties").Properties(
        import_module("paho.mqtt.packettypes").PacketTypes.CONNECT
    )
    properties.MaximumPacketSize = packet_bytes
    return properties
