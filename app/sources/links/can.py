"""The CAN link: any python-can interface and channel, read in a thread of its own, opened again for ever."""

import contextlib
import re
import threading
from collections.abc import Callable
from urllib.parse import parse_qsl

from app.clock import Clock
from app.errors import ConfigError, LinkLost, message_of
from app.sources.items import CanFault, CanItem, Item, LinkChange
from app.sources.links.backoff import Backoff
from app.sources.links.can_controller import ControllerWatch
from app.sources.links.can_request import Value, check_channel, check_request
from app.sources.links.python_can import can
from app.sources.links.slcan_lines import open_bus
from app.words import Message, Text
from firmware_protocol.memory_map import CAN_ID_EXTENDED

_POLL_S = 0.2
_SEND_S = 0.5
_ASK_S = 1.0  # between two questions to the adapter's controller
DEFAULT_BIT_RATE = 500_000
FD_BY_A_FLAG = ("socketcan", "udp_multicast")


def parse_bus(text: str, *, by_operator: bool = False) -> dict[str, Value]:
    """Return python-can's arguments for INTERFACE:CHANNEL[?key=value&...]; numbers and true/false are converted.

    Args:
        text: of the bus.
        by_operator: the command line or the environment names it: any interface and any option.

    Raises:
        ConfigError: no colon, an interface that python-can does not have, a part that is not key=value, the channel
            of a serial adapter that is no serial port, or what a request may not name.
    """
    interface, colon, rest = text.partition(":")
    if not colon or not interface or not rest:
        raise ConfigError("can", text, Message("can-url"))
    if interface not in can.VALID_INTERFACES:
        raise ConfigError("can", text, Message("can-interface", names=tuple(sorted(can.VALID_INTERFACES))))
    channel, _, query = rest.partition("?")
    try:
        pairs = parse_qsl(query, strict_parsing=True) if query else []
    except ValueError as error:
        raise ConfigError("can", text, Message("can-options")) from error
    options = {key: _convert(value) for key, value in pairs}
    if not by_operator:
        check_request(text, interface, channel, options)
    check_channel(text, interface, channel, by_operator=by_operator)
    return {"bitrate": DEFAULT_BIT_RATE, **options, "interface": interface, "channel": channel}


def bit_rate_of(url: str | None) -> int | None:
    """Return the bit rate that a bus is named with, None where it is not [bit/s]."""
    told = None if url is None or not re.search(r"[?&]bitrate=", url) else parse_bus(url, by_operator=True)["bitrate"]
    return told if type(told) is int and told > 0 else None


def _convert(value: str) -> Value:
    if value.lower() in ("true", "false"):
        return value.lower() == "true"
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(value)
    return value


class CanLink:
    """Delivers data frames to `sink`, from its own thread."""

    def __init__(self, url: str, sink: Callable[[Item], None], clock: Clock, *, fd: bool = False) -> None:
        """Prepare the bus.

        Args:
            url: INTERFACE:CHANNEL[?key=value&...].
            sink: takes what is heard.
            clock: of what is heard.
            fd: frames of CAN FD are awaited, where one flag is all that the adapter asks for.
        """
        self.url = url
        self._arguments = parse_bus(url, by_operator=True)  # of a request it was checked before
        if fd and self._arguments["interface"] in FD_BY_A_FLAG:
            self._arguments.setdefault("fd", True)
        self._sink = sink
        self._clock = clock
        self._stopping = threading.Event()
        self._sending = threading.Lock()
        self._bus: can.BusABC | None = None
        self.beat_ns: int | None = None  # when the thread was last seen at work; None before it starts
        self._thread = threading.Thread(target=self._run, name="can", daemon=True)

    def start(self) -> None:
        """Begin to open the bus."""
        self._thread.start()

    def stop(self) -> None:
        """Close the bus and end the thread."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout=3.0)

    def _run(self) -> None:
        backoff = Backoff()
        self._report("connecting")
        while not self._stopping.is_set():
            self.beat_ns = self._clock.monotonic_ns()
            try:
                bus = open_bus(self._arguments)
            except Exception as error:  # noqa: BLE001  every driver raises its own
                self._report("lost", message_of(error))
                self._stopping.wait(backoff.next_s())
                continue
            self._report("open")
            with self._sending:
                self._bus = bus
            try:
                self._read_until_lost(bus, backoff.reset)
            except Exception as error:  # noqa: BLE001  every driver raises its own
                if not self._stopping.is_set():
                    self._report("lost", message_of(error))
            finally:
                with self._sending, contextlib.suppress(Exception):
                    self._bus = None
                    bus.shutdown()
            self._stopping.wait(backoff.next_s())

    def _read_until_lost(self, bus: can.BusABC, on_data: Callable[[], None]) -> None:
        watch, asked_s = ControllerWatch(str(self._arguments["interface"])), self._clock.monotonic_s()
        watch.ask(bus)
        self._report_fault(watch)
        while not self._stopping.is_set():
            message = bus.recv(_POLL_S)
            self.beat_ns = self._clock.monotonic_ns()
            if message is not None and message.is_error_frame:
                watch.on_error_frame(message)
                self._report_fault(watch)
            if self._clock.monotonic_s() - asked_s > _ASK_S:
                asked_s = self._clock.monotonic_s()
                if watch.ask(bus):
                    self._report_fault(watch)
            if message is None or message.is_error_frame or message.is_remote_frame:
                continue
            on_data()
            can_id = message.arbitration_id | (CAN_ID_EXTENDED if message.is_extended_id else 0)
            self._sink(CanItem(self._clock.monotonic_ns(), self._clock.wall_ns(), can_id, bytes(message.data)))

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame; bit 31 of the id marks a 29-bit one. It is delivered to the sink as sent.

        Raises:
            LinkLost: the bus is not open, or refuses the frame.
        """
        message = can.Message(
            arbitration_id=can_id & ~CAN_ID_EXTENDED, is_extended_id=bool(can_id & CAN_ID_EXTENDED), data=data
        )
        with self._sending:
            if self._bus is None:
                raise LinkLost(Message("can-not-open"))
            try:
                self._bus.send(message, timeout=_SEND_S)
            except Exception as error:  # every driver raises its own
                raise LinkLost(Message("can-refused-frame", error=message_of(error))) from error
        self._sink(CanItem(self._clock.monotonic_ns(), self._clock.wall_ns(), can_id, bytes(data), sent=True))

    def _report_fault(self, watch: ControllerWatch) -> None:
        now_ns, wall_ns = self._clock.monotonic_ns(), self._clock.wall_ns()
        errors = watch.errors, watch.tx_errors, watch.rx_errors
        self._sink(CanFault(now_ns, wall_ns, watch.state, *errors))

    def _report(self, state: str, error: Text | None = None) -> None:
        self._sink(LinkChange(self._clock.monotonic_ns(), self._clock.wall_ns(), "can", state, error))  # type: ignore[arg-type]
