"""What a CAN adapter's own controller says: errors seen, its two error counters, its state. None where it does not say.

Adapters differ: some pass error frames on, in SocketCAN's form or in one of their own, some can be asked, most cheap
serial ones do neither. What a form means is only read where the form is known.
"""

import contextlib
from typing import Any

from app.sources.links.python_can import can
from app.telemetry import BusState

# bits of an error frame's id and of its bytes, linux/can/error.h
_CONTROLLER, _BUS_OFF, _RESTARTED, _COUNTERS = 0x04, 0x40, 0x100, 0x200
_PASSIVE, _WARNING, _ACTIVE = 0x30, 0x0C, 0x40  # second byte
_TX_BYTE, _RX_BYTE = 6, 7
# PCANBasic.h: PCAN_ERROR_BUSOFF, _BUSPASSIVE, _BUSWARNING and _BUSLIGHT
_PCAN_STATES: tuple[tuple[int, BusState], ...] = ((0x10, "off"), (0x40000, "passive"), (0x0C, "warning"))

LINUX_FORM = frozenset({"socketcan", "gs_usb", "socketcand", "virtual"})
COUNTING = frozenset(
    {"socketcan", "gs_usb", "pcan", "kvaser", "vector", "ixxat", "neovi", "nican", "nixnet", "usb2can"}
)  # hand error frames on, so that none heard means none seen


def reported_state(message: can.Message) -> BusState | None:
    """Return the state that an error frame of SocketCAN's form tells; None where it tells of something else."""
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
    """One opened bus's controller, as far as it is known."""

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
