"""Ports onto the simulated CAN bus: an emulated slcan adapter on a byte port, or any bus that python-can opens."""

import logging
import selectors
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TextIO
from urllib.parse import parse_qsl

from simulator.can_bus import PASSIVE, WARNING, CanBus, CanFrame
from simulator.errors import PortError
from simulator.ports import BytePort, byte_port
from simulator.slcan import SlcanAdapter

_hides_asammdf = "asammdf" not in sys.modules
if (
    _hides_asammdf
):  # python-can imports it for files that nobody reads here, and with it pandas: a second of every start
    sys.modules["asammdf"] = None  # type: ignore[assignment]
try:
    import can
finally:
    if _hides_asammdf:
        del sys.modules["asammdf"]

log = logging.getLogger(__name__)
_BUS_ERROR, _OFF, _CONTROLLER = 0x80, 0x40, 0x04  # bits of an error frame's id (linux/can/error.h)
_PASSIVE_BITS, _WARNING_BITS = 0x30, 0x0C  # bits of the error frame's second byte


class CanPort(Protocol):
    """A port onto the simulated bus, driven by the runner."""

    @property
    def url(self) -> str:
        """Return INTERFACE:CHANNEL, with which a program opens the other end."""
        ...

    def open(self, selector: selectors.BaseSelector, bus: CanBus, now_s: Callable[[], float]) -> None:
        """Open, and become a node of the bus; PortError where that fails."""
        ...

    def poll(self) -> None:
        """Do what the selector cannot: take waiting frames, keep the port open."""
        ...

    def close(self) -> None:
        """Leave the bus and close."""
        ...

    def carry_fd(self) -> None:
        """Say before it is opened that CAN FD frames will come."""
        ...


class SlcanPort:
    """An slcan adapter behind a pseudo-terminal or a socket."""

    def __init__(self, port: BytePort) -> None:
        self._port = port
        self._bus: CanBus | None = None
        self._adapter: SlcanAdapter | None = None

    @property
    def url(self) -> str:
        """`slcan:` and the channel."""
        return f"slcan:{self._port.url}"

    def open(self, selector: selectors.BaseSelector, bus: CanBus, now_s: Callable[[], float]) -> None:
        """Open the byte port and put the adapter on the bus."""
        adapter = SlcanAdapter(bus, self._port.write)
        self._port.open(selector, lambda data: adapter.feed(data, now_s()))
        bus.attach(adapter)
        self._bus, self._adapter = bus, adapter

    def carry_fd(self) -> None:
        """The emulated adapter carries them."""

    def poll(self) -> None:
        """Keep the byte port open; the selector watches it."""
        self._port.tend()

    def close(self) -> None:
        """Take the adapter off the bus."""
        if self._bus is not None and self._adapter is not None:
            self._bus.detach(self._adapter)
            self._port.close()
            self._bus = None


class PythonCanPort:
    """A bus that python-can opens, at the bit rate it was given (default: 500 kbit/s).

    Its `virtual` bus shows the error frames of ours in SocketCAN's form, with what this node's counters say of it; on
    real buses each controller makes its own.
    """

    is_listening_only = False

    def __init__(self, interface: str, channel: str, options: dict[str, Any]) -> None:
        self._interface = interface
        self._channel = channel
        self._options = options
        self._device: can.BusABC | None = None
        self._bus: CanBus | None = None
        self._now_s: Callable[[], float] = float

    @property
    def url(self) -> str:
        """INTERFACE:CHANNEL."""
        return f"{self._interface}:{self._channel}"

    @property
    def bit_rate(self) -> int:
        """The bit rate it was opened with [bit/s]."""
        return int(self._options.get("bitrate", 500_000))

    def open(self, selector: selectors.BaseSelector, bus: CanBus, now_s: Callable[[], float]) -> None:
        """Open the bus and become a node of the simulated bus."""
        try:
            self._device = can.Bus(channel=self._channel, interface=self._interface, **self._options)
        except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
            raise PortError(self.url, str(error)) from error
        self._bus, self._now_s = bus, now_s
        bus.attach(self)
        if self._interface == "virtual":
            bus.error_listeners.append(self._show_error)

    def _show_error(self) -> None:
        if self._bus is None:
            return
        station = self._bus.station(self)
        errors = max(station.transmit_errors, station.receive_errors)
        of_controller = _PASSIVE_BITS if errors >= PASSIVE else _WARNING_BITS if errors >= WARNING else 0
        kind = _BUS_ERROR | _CONTROLLER * bool(of_controller) | _OFF * self._bus.is_off(self)
        self._send(can.Message(is_error_frame=True, arbitration_id=kind, data=bytes((0, of_controller, *[0] * 6))))

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Send a frame of the simulated bus."""
        message = can.Message(
            arbitration_id=frame.can_id,
            is_extended_id=frame.is_extended,
            data=frame.data,
            is_fd=frame.is_fd,
            bitrate_switch=frame.is_fd,
        )
        self._send(message)

    def _send(self, message: can.Message) -> None:
        if self._device is None:
            return
        try:
            self._device.send(message, timeout=0)
        except (can.CanError, OSError, ValueError) as error:
            log.debug("%s: frame lost: %s", self.url, error)

    def carry_fd(self) -> None:
        """Open the bus with `fd=True` unless its options say otherwise."""
        self._options.setdefault("fd", True)

    def poll(self) -> None:
        """Take the frames that others sent."""
        if self._device is None or self._bus is None:
            return
        while (message := self._device.recv(0)) is not None:
            if message.is_error_frame or message.is_remote_frame or message.is_fd:
                continue
            frame = CanFrame(message.arbitration_id, message.is_extended_id, bytes(message.data))
            self._bus.send(self, frame, self._now_s())

    def close(self) -> None:
        """Leave both buses."""
        if self._device is not None and self._bus is not None:
            self._bus.detach(self)
            if self._show_error in self._bus.error_listeners:
                self._bus.error_listeners.remove(self._show_error)
            self._device.shutdown()
            self._device = None


class LogPort:
    """A log in candump's format: what passes the bus, with the virtual time of each frame."""

    is_listening_only = False
    bit_rate = 500_000

    def __init__(self, file: str) -> None:
        self._file = file
        self._stream: TextIO | None = None
        self._bus: CanBus | None = None

    @property
    def url(self) -> str:
        """`log:` and the file."""
        return f"log:{self._file}"

    def carry_fd(self) -> None:
        """A log carries all frames."""

    def open(self, selector: selectors.BaseSelector, bus: CanBus, now_s: Callable[[], float]) -> None:
        """Begin the file."""
        try:
            self._stream = Path(self._file).open("w", encoding="ascii")  # noqa: SIM115  open until `close`
        except OSError as error:
            raise PortError(self.url, error.strerror or str(error)) from error
        self._bus = bus
        bus.attach(self)

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Write a frame."""
        if self._stream is not None:
            can_id = f"{frame.can_id:08X}" if frame.is_extended else f"{frame.can_id:03X}"
            mark = "##1" if frame.is_fd else "#"  # 1: the bit rate was switched
            self._stream.write(f"({now_s:.6f}) can0 {can_id}{mark}{frame.data.hex().upper()}\n")

    def poll(self) -> None:
        """Nothing waits."""

    def close(self) -> None:
        """End the file."""
        if self._stream is not None and self._bus is not None:
            self._bus.detach(self)
            self._stream.close()
            self._stream = None


def can_port(text: str) -> CanPort:
    """Return the port of `slcan-pty:LINK`, `slcan-tcp:PORT`, `log:FILE` or `INTERFACE:CHANNEL[?key=value&...]`.

    Raises:
        PortError: it names none of them.
    """
    interface, separator, rest = text.partition(":")
    if not interface or not separator:
        raise PortError(text, "give slcan-pty:LINK, slcan-tcp:PORT, log:FILE or INTERFACE:CHANNEL")
    if interface == "log":
        return LogPort(rest)
    if interface in ("slcan-pty", "slcan-tcp"):
        return SlcanPort(byte_port(f"{interface.removeprefix('slcan-')}:{rest}"))
    channel, _, query = rest.partition("?")
    return PythonCanPort(interface, channel, {key: _typed(value) for key, value in parse_qsl(query)})


def _typed(value: str) -> bool | int | str:
    if value.lower() in ("true", "false"):
        return value.lower() == "true"
    try:
        return int(value, 0)
    except ValueError:
        return value
