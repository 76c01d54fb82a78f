"""The CAN link: any python-can interface and channel, read in a thread of its own, opened again for ever."""

import contextlib
import threading
from collections.abc import Callable
from typing import Any

from app.clock import Clock
from app.errors import LinkLost, message_of
from app.sources.items import CanFault, CanItem, Item, LinkChange
from app.sources.links.can_bus import bus_reason, can, open_bus, parse_bus
from app.sources.links.serial import Backoff
from app.telemetry import BusState
from app.words import Message, Text
from firmware_protocol.memory_map import CAN_ID_EXTENDED

_POLL_S = 0.2
_SEND_S = 0.5
_ASK_S = 1.0  # between two questions to the adapter's controller
FD_BY_A_FLAG = ("socketcan", "udp_multicast")


# bits of an error frame's id and of its bytes, linux/can/error.h
_CONTROLLER, _BUS_OFF, _RESTARTED, _COUNTERS = 0x04, 0x40, 0x100, 0x200
_PASSIVE, _WARNING, _ACTIVE = 0x30, 0x0C, 0x40  # second byte
_TX_BYTE, _RX_BYTE = 6, 7
# PCANBasic.h: PCAN_ERROR_BUSOFF, _BUSPASSIVE, _BUSWARNING and _BUSLIGHT
_PCAN_STATES: tuple[tuple[int, BusState], ...] = ((0x10, "off"), (0x40000, "passive"), (0x0C, "warning"))

LINUX_FORM = frozenset({"socketcan", "gs_usb", "socketcand", "virtual"})
COUNTING = frozenset(
    {"socketcan", "gs_usb", "pcan", "kvaser", "vector", "ixxat", "neovi", "nican", "nixnet", "usb2can"}
)  # hand error frames on, so that none received means none seen


def reported_state(message: can.Message) -> BusState | None:
    """Return the state in an error frame of SocketCAN's form; None where it is about something else."""
    if message.arbitration_id & _BUS_OFF:
        return "off"
    if message.arbitration_id & _CONTROLLER and len(message.data) > 1:
        bits = message.data[1]
        if bits & _PASSIVE:
            return "passive"
        if bits & _WARNING:
            return "warning"
        if bits & _ACTIVE:
            return "active"
    return "active" if message.arbitration_id & _RESTARTED else None


class ControllerWatch:
    """Watches an opened adapter's controller: errors seen, its two error counters, its state; None: nothing.

    Adapters differ: some pass error frames on, in SocketCAN's form or in one of their own, some can be asked, most
    cheap serial ones do neither. What a form means is only read where the form is known.
    """

    def __init__(self, interface: str) -> None:
        self._interface = interface
        self.errors: int | None = 0 if interface in COUNTING else None
        self.state: BusState | None = None
        self.tx_errors: int | None = None
        self.rx_errors: int | None = None

    def on_error_frame(self, message: can.Message) -> None:
        """Count it, and read it where its form is known."""
        self.errors = (self.errors or 0) + 1
        if self._interface not in LINUX_FORM:
            return
        self.state = reported_state(message) or self.state
        if message.arbitration_id & _COUNTERS and len(message.data) > _RX_BYTE:
            self.tx_errors, self.rx_errors = message.data[_TX_BYTE], message.data[_RX_BYTE]

    def ask(self, bus: can.BusABC) -> bool:
        """Ask an adapter that can be asked; True where its state is another one than before."""
        before = self.state
        with contextlib.suppress(Exception):  # an answer that does not come is no answer
            self.state = self._asked(bus)
        return self.state != before

    def _asked(self, bus: Any) -> BusState | None:
        match self._interface:
            case "pcan":
                status = int(bus.status())
                return next((state for bits, state in _PCAN_STATES if status & bits), "active")
            case "ixxat":  # its PASSIVE means that it only listens, its ERROR that it is off the bus
                return "off" if bus.state is can.BusState.ERROR else "active"
            case "etas":
                return {can.BusState.ACTIVE: "active", can.BusState.PASSIVE: "passive"}.get(bus.state)  # type: ignore[return-value]
        return self.state


class CanLink:
    """Delivers data frames to `sink`, from its own thread."""

    def __init__(self, url: str, sink: Callable[[Item], None], clock: Clock, *, fd: bool = False) -> None:
        """Prepare the bus.

        Args:
            url: INTERFACE:CHANNEL[?key=value&...].
            sink: takes what is received.
            clock: of what is received.
            fd: frames of CAN FD are awaited, where one flag is all that the adapter asks for.
        """
        self.url = url
        self._arguments = parse_bus(url, by_operator=True)  # a request's was checked before
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
                self._report("lost", bus_reason(error, self.url))
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
