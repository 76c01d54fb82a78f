"""The car's nodes of the CAN bus: the master while it runs, the charger while plugged in, and a babbling node."""

from collections.abc import Callable

from firmware_protocol.elcon import BIT_RATE_6K6, COMMAND_ID
from simulator.can_bus import CanBus, CanFrame
from simulator.charger_unit import ChargerUnit
from simulator.master import VirtualMaster

_BABBLE = CanFrame(0, False, bytes(8))  # no frame has more weight


class MasterOnBus:
    """The master's controller; off while the master is not running or is bus-off."""

    is_listening_only = False

    def __init__(self, running: Callable[[], VirtualMaster | None]) -> None:
        self._running = running
        self.is_held_off = False  # by a fault, not by its error counter

    @property
    def bit_rate(self) -> int:
        """The bit rate of the configuration in force [bit/s]."""
        master = self._running()
        return 0 if master is None or self.is_held_off else master.bit_rate

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Hand a frame to the running master."""
        master = self._running()
        if master is not None:
            master.can_received(frame, now_s)


class ChargerOnBus:
    """The charger, on the bus while it is plugged in."""

    is_listening_only = False

    def __init__(self, unit: ChargerUnit) -> None:
        self.unit = unit
        self.is_plugged = False
        self.bit_rate_plugged = BIT_RATE_6K6

    @property
    def bit_rate(self) -> int:
        """The bit rate that the unit was built for [bit/s]."""
        return self.bit_rate_plugged if self.is_plugged else 0

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Take a command."""
        if frame.is_extended and frame.can_id == COMMAND_ID:
            self.unit.receive(frame.data)


class CarUnits:
    """The other units of the car, such as its ECU: they acknowledge what is sent, and send nothing."""

    is_listening_only = False

    def __init__(self, bit_rate: Callable[[], int]) -> None:
        self._bit_rate = bit_rate
        self._rate = 0

    @property
    def bit_rate(self) -> int:
        """That of the bus, also while the battery is off [bit/s]."""
        self._rate = self._bit_rate() or self._rate
        return self._rate

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Ignore it."""


class BabblingNode:
    """A node that occupies the bus with frames of the highest priority, for a share of the time."""

    is_listening_only = False

    def __init__(self, rate_of: Callable[[], int]) -> None:
        self._rate_of = rate_of
        self.share = 0.0

    @property
    def bit_rate(self) -> int:
        """The master's bit rate, 0 while the node sends nothing [bit/s]."""
        return self._rate_of() if self.share else 0

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Ignore every frame."""

    def step(self, bus: CanBus, now_s: float, dt_s: float) -> None:
        """Queue enough frames to fill its share of the next step."""
        for _ in range(round(self.share * dt_s * self.bit_rate / _BABBLE.bits)):
            bus.send(self, _BABBLE, now_s)
