"""Runs a simulation against the wall clock, or as fast as possible, and moves bytes between it and its ports.

One thread, one selector. A run that falls behind loses the time instead of sending faster than the line could.
"""

import math
import selectors
import time
from collections.abc import Callable

from simulator.can_ports import CanPort
from simulator.errors import InputError, SimulatorError
from simulator.ports import BytePort
from simulator.vehicle import Vehicle

MAX_LAG_S = 0.05  # wall time that may be caught up
_BURST_S = 0.1  # virtual time between two polls of the ports, when as fast as possible
_MAX_WAIT_S = 0.25


class Runner:
    """Drives one simulation with its ports until stopped."""

    def __init__(
        self,
        simulation: Vehicle,
        *,
        serial: BytePort | None = None,
        can: list[CanPort] | None = None,
        speed: float | None = 1.0,
    ) -> None:
        """Take the simulation and its ports; `speed` is virtual seconds per second, None as fast as possible."""
        self.simulation = simulation
        self.speed = speed
        self.selector = selectors.DefaultSelector()
        self._serial = serial
        self._can = can or []
        self._clock = time.monotonic
        self._epoch_s = 0.0
        self._plug_at_s = math.inf
        self._is_stopping = False

    def open(self) -> None:
        """Open the ports; PortError where one fails, the others are closed again."""
        opened: list[BytePort | CanPort] = []
        try:
            if self._serial is not None:
                self._serial.open(self.selector, self._received)
                self.simulation.serial_out = self._serial.write
                opened.append(self._serial)
            for can in self._can:
                can.open(self.selector, self.simulation.bus, lambda: self.simulation.now_s)
                opened.append(can)
        except SimulatorError:
            for port in opened:
                port.close()
            raise

    def stop(self) -> None:
        """Make `run` return soon; may be called from a signal handler or another thread."""
        self._is_stopping = True

    def run(self, duration_s: float | None = None, should_stop: Callable[[], bool] = bool) -> None:
        """Run until stopped, or for a virtual duration [s]."""
        end_s = float("inf") if duration_s is None else self.simulation.now_s + duration_s
        self._anchor()
        while not self._is_stopping and not should_stop() and self.simulation.now_s < end_s:
            self._turn(end_s)

    def close(self) -> None:
        """Close the ports."""
        for port in (self._serial, *self._can):
            if port is not None:
                port.close()
        self.selector.close()

    def unplug_serial(self, for_s: float) -> None:
        """Unplug the RS232 cable for a time of the wall clock: the device disappears and comes back.

        Raises:
            InputError: there is no such cable.
        """
        if self._serial is None:
            raise InputError("unplug", "there is no RS232 cable")
        self._serial.close()
        self._plug_at_s = self._clock() + for_s

    def _plug_serial(self) -> None:
        if self._serial is not None and self._clock() >= self._plug_at_s:
            self._plug_at_s = math.inf
            self._serial.open(self.selector, self._received)

    def set_speed(self, speed: float | None) -> None:
        """Change the speed."""
        self.speed = speed
        self._anchor()

    def _turn(self, end_s: float) -> None:
        simulation = self.simulation
        if self.speed is None:
            simulation.run_until(min(simulation.now_s + _BURST_S, end_s))
            wait_s = 0.0
        else:
            simulation.run_until(min(self._virtual_now_s(self.speed), end_s))
            ahead_s = (simulation.next_due_s() - simulation.now_s) / self.speed
            late_s = (self._clock() - self._epoch_s) - simulation.now_s / self.speed
            wait_s = min(max(ahead_s - late_s, 0.0), _MAX_WAIT_S)
        ready = self.selector.select(wait_s) if self.selector.get_map() else _sleep(wait_s)
        if ready and self.speed is not None:
            simulation.run_until(min(self._virtual_now_s(self.speed), end_s))
        for key, _ in ready:
            key.data()
        self._plug_serial()
        if self._serial is not None:
            self._serial.tend()
        for can in self._can:
            can.poll()

    def _received(self, data: bytes) -> None:
        self.simulation.receive(data)

    def _anchor(self) -> None:
        self._epoch_s = self._clock() - (0.0 if self.speed is None else self.simulation.now_s / self.speed)

    def _virtual_now_s(self, speed: float) -> float:
        elapsed_s = self._clock() - self._epoch_s
        lag_s = elapsed_s - self.simulation.next_due_s() / speed
        if lag_s > MAX_LAG_S:
            self._epoch_s += lag_s - MAX_LAG_S
            elapsed_s -= lag_s - MAX_LAG_S
        return elapsed_s * speed


def _sleep(seconds: float) -> list[tuple[selectors.SelectorKey, int]]:
    time.sleep(seconds)
    return []
