"""Serial ports and CAN adapters of this machine, and what arrives when one of them is opened."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass

from serial.tools import list_ports

from app.battery.serial import SerialMapping
from app.errors import message_of
from app.sources.links.can_bus import can, open_bus, parse_bus
from app.sources.links.profile_serial import Requests
from app.sources.links.serial import reason_of
from app.sources.links.serial_url import MASTER_PORT, check_url, open_port
from app.words import Message, Text
from firmware_protocol.framing import Frame, FrameDecoder

CHECK_S = 1.5
_POLL_S = 0.1
_NO_ADAPTERS = ("virtual", "udp_multicast", "serial")  # that python-can finds on every machine
_SEARCH_S = 3.0


@dataclass(frozen=True, slots=True)
class Found:
    """A port or an adapter."""

    url: str  # as `--serial` or `--can` takes it
    description: str


@dataclass(frozen=True, slots=True)
class LinkCheck:
    """Result of listening for CHECK_S, and the remedy where something is not right."""

    bytes: int
    frames: int
    error: Text | None
    advice: Message | None


def serial_ports() -> list[Found]:
    """Return the serial ports of this machine; those of adapters on USB come first."""
    ports = sorted(list_ports.comports(), key=lambda port: (port.vid is None, port.device))
    return [Found(port.device, _described(port.description)) for port in ports]


def _described(text: str | None) -> str:
    return "" if text in ("n/a", None) else str(text)


def can_adapters() -> list[Found]:
    """Return the CAN adapters that python-can finds, then serial adapters, which may be SLCAN."""
    named = [name for name in can.VALID_INTERFACES if name not in _NO_ADAPTERS]
    adapters = [
        Found(f"{config['interface']}:{config['channel']}", str(config.get("device_name", "")))
        for config in can.detect_available_configs(named, timeout=_SEARCH_S)
    ]
    usb = [port for port in list_ports.comports() if port.vid is not None]
    return adapters + [Found(f"slcan:{port.device}", _described(port.description)) for port in usb]


def check_serial(
    url: str, mapping: SerialMapping | None = None, count: Callable[[bytes], int] | None = None
) -> LinkCheck:
    """Open a port that a request names as the service would, and count what arrives.

    Args:
        url: of the port.
        mapping: what is on the line; None: a master of ours.
        count: returns how many frames of it some bytes complete.

    Raises:
        ConfigError: it is none that a request may name.
    """
    check_url(url)
    received = frames = 0
    if count is None:
        decoder = FrameDecoder()
        count = lambda data: sum(isinstance(frame, Frame) for frame in decoder.feed(data))  # noqa: E731
    settings = MASTER_PORT if mapping is None else mapping.port
    requests = None if mapping is None else Requests(mapping)
    try:
        port = open_port(url, _POLL_S, settings)
    except Exception as error:  # noqa: BLE001  drivers raise their own
        reason = reason_of(error)
        code = reason.code if isinstance(reason, Message) else ""
        return LinkCheck(0, 0, reason, _ADVICE.get(code, Message("advice-no-port")))
    try:
        port.write(settings.start)
        end = time.monotonic() + CHECK_S
        while (now_s := time.monotonic()) < end:
            if requests is not None and (request := requests.next(now_s)):
                port.write(request)
            data = bytes(port.read(max(1, port.in_waiting)))
            received += len(data)
            frames += count(data)
        with contextlib.suppress(Exception):
            port.write(settings.stop)
    except Exception as error:  # noqa: BLE001  drivers raise their own
        return LinkCheck(received, frames, reason_of(error), Message("advice-no-port"))
    finally:
        port.close()
    return LinkCheck(received, frames, None, _on_serial(received, frames))


def _on_serial(received: int, frames: int) -> Message | None:
    if frames:
        return None
    return Message("advice-no-frame") if received else Message("advice-silent")


_ADVICE = {"port-denied": Message("advice-denied"), "port-in-use": Message("advice-in-use")}


def check_can(url: str) -> LinkCheck:
    """Open a bus that a request names as the service would, and count its frames.

    Raises:
        ConfigError: it is none that a request may name.
    """
    arguments = parse_bus(url)
    received = frames = 0
    try:
        with open_bus(arguments) as bus:
            end = time.monotonic() + CHECK_S
            while time.monotonic() < end:
                message = bus.recv(_POLL_S)
                if message is not None and not message.is_error_frame:
                    frames += 1
                    received += len(message.data)
    except Exception as error:  # noqa: BLE001  every driver raises its own
        return LinkCheck(received, frames, message_of(error), Message("advice-can-open"))
    return LinkCheck(received, frames, None, None if frames else Message("advice-can-silent"))
