"""The links to the car: RS232 with the requests to the master, CAN with the frames that users send."""

import threading
from collections.abc import Callable

from app.battery.serial import SerialMapping
from app.clock import Clock
from app.errors import LinkLost
from app.sources.items import Item
from app.sources.links.can import CanLink
from app.sources.links.can_sender import CanSender
from app.sources.links.profile_serial import ProfileSerialLink
from app.sources.links.serial import SerialLink
from app.sources.master.client import MasterClient
from app.telemetry.events import link_stuck
from app.words import Message

STUCK_S = 120.0  # a thread that a driver has kept for so long does not come back; a name server alone may take 40 s


class ServiceLinks:
    """Opens and closes the configured links; sending on one that is not configured is LinkLost."""

    def __init__(
        self,
        serial_url: str | None,
        can_url: str | None,
        sink: Callable[[Item], None],
        clock: Clock,
        *,
        may_transmit: bool,
        can_fd: bool = False,
        mapping: SerialMapping | None = None,
    ) -> None:
        """Prepare the links.

        Args:
            serial_url: of the RS232 link; None = not configured.
            can_url: of the CAN link; None = not configured.
            sink: takes what they deliver.
            clock: of the links and of the requests to the master.
            may_transmit: this is no car's bus.
            can_fd: frames of CAN FD are awaited.
            mapping: of the serial line, where no master of ours is on it.
        """
        self.serial = _serial_link(serial_url, mapping, sink, clock) if serial_url else None
        self.can = CanLink(can_url, sink, clock, fd=can_fd) if can_url else None
        self.can_sender = CanSender(self.send_can, clock)
        has_master = self.serial is not None and mapping is None
        self.master = MasterClient(self.serial.write if self.serial and has_master else _refuse, clock)
        if self.serial is not None and has_master:
            self.serial.on_frame, self.serial.on_lost = self.master.on_frame, self.master.on_lost
        self._clock = clock
        self._lock = threading.Lock()
        self._is_closed = False
        self._may_transmit = may_transmit

    def open(self) -> None:
        """Open every link; nothing once `close` was called."""
        with self._lock:
            if self._is_closed:
                return
            for link in (self.serial, self.can):
                if link is not None:
                    link.start()

    def close(self) -> None:
        """Let requests that wait give up, stop sending, close the links."""
        with self._lock:
            self._is_closed = True
        self.master.close()
        self.can_sender.stop()
        for link in (self.serial, self.can):
            if link is not None:
                link.stop()

    def stuck(self) -> list[Message]:
        """Return the links whose thread hangs in its driver or has ended; a silent or unplugged one is none."""
        named = (("rs232", self.serial), ("can", self.can))
        beats = [(name, link.beat_ns) for name, link in named if link is not None]
        now_ns = self._clock.monotonic_ns()
        silent = [(name, (now_ns - beat_ns) / 1e9) for name, beat_ns in beats if beat_ns is not None]
        return [link_stuck(name, silent_s) for name, silent_s in silent if silent_s > STUCK_S]

    @property
    def transmit_block_reason(self) -> Message | None:
        """Return why users may not send CAN frames; None where they may."""
        if self.can is None:
            return Message("no-can")
        if not self._may_transmit:
            return Message("bench-only")
        return None

    def stream(self, *, on: bool) -> None:
        """Start or stop the master's stream.

        Raises:
            LinkLost: no RS232 port is configured, or it is not open.
        """
        if self.serial is None:
            raise LinkLost(Message("no-rs232"))
        self.serial.stream(on=on)

    def send_can(self, can_id: int, data: bytes) -> None:
        """Send a frame; bit 31 of the id marks a 29-bit one.

        Raises:
            LinkLost: no CAN bus is configured, it is not open, or it refuses the frame.
        """
        if self.can is None:
            raise LinkLost(Message("no-can"))
        self.can.send(can_id, data)


def _serial_link(url: str, mapping: SerialMapping | None, sink: Callable[[Item], None], clock: Clock) -> SerialLink:
    return SerialLink(url, sink, clock) if mapping is None else ProfileSerialLink(url, mapping, sink, clock)


def _refuse(data: bytes) -> None:
    raise LinkLost(Message("no-rs232"))
