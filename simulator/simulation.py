"""Everything in virtual time: accumulator, load, charger, master, its line and its bus, advanced event by event.

No wall clock and no ports here: whoever runs it says until when, gives bytes in and takes bytes out.
"""

import math

import numpy as np

from firmware_protocol.elcon import STATUS_ID
from firmware_protocol.framing import LINE_BYTES_PER_S
from simulator.accumulator import AccumulatorParameters
from simulator.balancing.circuits import Balance, balancing_circuit
from simulator.bms_state import RelayState
from simulator.board import Board
from simulator.bus_nodes import MasterOnBus
from simulator.can_bus import CanFrame
from simulator.eeprom import Eeprom
from simulator.master import VirtualMaster
from simulator.slave import THESIS_SENSOR_INPUTS
from simulator.vehicle import COMMANDED, PASS_S, Vehicle


class UartLine:
    """One direction of the line, from the master to the host."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._in_flight: bytes = b""
        self.is_busy = False  # a frame is on the wire
        self.busy_until_s = 0.0
        self.bytes_sent = 0
        self.noise_per_byte = 0.0
        self.is_stuck = False
        self.is_dropping = False

    def send(self, frame: bytes, now_s: float) -> None:
        """Put the next frame on the wire; the caller waits until it is free."""
        self._in_flight, self.is_busy = frame, bool(frame)
        self.busy_until_s = max(now_s, self.busy_until_s) + len(frame) / LINE_BYTES_PER_S

    def take(self) -> bytes:
        """Return the received bytes of the frame whose last byte was just sent, and free the wire."""
        frame, self._in_flight, self.is_busy = self._in_flight, b"", False
        self.bytes_sent += len(frame)
        return self.disturb(frame)

    def disturb(self, data: bytes) -> bytes:
        """Return the bytes after the disturbances of the line."""
        if self.is_stuck:
            return b""
        if self.is_dropping:
            return data[: int(self._rng.integers(len(data) + 1))]
        if not self.noise_per_byte:
            return data
        hits = np.flatnonzero(self._rng.random(len(data)) < self.noise_per_byte)
        out = bytearray(data)
        for hit in hits:
            out[hit] ^= 1 << int(self._rng.integers(8))
        return bytes(out)


SLOW_PERIOD_S = 0.2  # period of temperatures and of the driver's wishes
_ROUNDING_S = 1e-6  # times are sums of steps
_LINE_RETRY_S = 1e-3  # a free line is asked again this much later when it had nothing, whatever it promised


class Simulation(Vehicle):
    """The team's own car, behind its master."""

    board: Board
    master_on_bus: MasterOnBus

    def __init__(
        self,
        parameters: AccumulatorParameters,
        *,
        eeprom: Eeprom | None = None,
        seed: int = 0,
        step_s: float = PASS_S,
        balancing: str = "passive",
        sensor_inputs: tuple[int, ...] = THESIS_SENSOR_INPUTS,
    ) -> None:
        super().__init__(parameters, seed=seed, step_s=step_s)
        self._balancing = balancing_circuit(balancing, self.accumulator)
        self.board = Board(eeprom or Eeprom(), self.rng, sensor_inputs)
        self.master_on_bus = MasterOnBus(lambda: self.master)
        self.bus.attach(self.master_on_bus)
        self.bus.attach(self.units)
        self.bus.attach(self.charger)
        self.bus.attach(self.babbler, max_waiting=4096)
        self.line = UartLine(self.rng)
        self._line_due_s = 0.0
        self._slow_due_s = 0.0
        self._wants_drive = False
        self.master: VirtualMaster | None = None
        self._boot()

    @property
    def operated(self) -> VirtualMaster | None:
        """The master while it runs."""
        return self.master

    def next_due_s(self) -> float:
        """Return the next instant at which something happens by itself [s]."""
        line_s = self.line.busy_until_s if self.line.is_busy else self._line_due_s
        return min(self._steps * self.step_s, line_s, self.bus.due_s)

    def run_until(self, until_s: float) -> None:
        """Advance to an instant, everything due until then included."""
        line, bus = self.line, self.bus
        while (due_s := self.next_due_s()) <= until_s:
            self.now_s = now_s = max(self.now_s, due_s)
            has_news = self._line_due_s <= now_s
            if self._steps * self.step_s <= now_s:
                self._step()
                has_news = True
            if line.is_busy and line.busy_until_s <= now_s:
                self._deliver(line.take())
                has_news = True
            if bus.due_s <= now_s:
                bus.run(now_s)
            if has_news and not line.is_busy:
                self._pump()
        self.now_s = max(self.now_s, until_s)

    def receive(self, data: bytes) -> None:
        """Take bytes that reach the master's UART now."""
        if self.master is not None:
            self.master.receive(self.line.disturb(data), self.now_s)
            if not self.line.is_busy:
                self._pump()

    def _switch_off(self) -> None:
        self.master = None

    def _boot(self) -> None:
        self.master = VirtualMaster(self.board, self.now_s, self._boot_cause)

    def _deliver(self, data: bytes) -> None:
        if data and self.serial_out is not None:
            self.serial_out(data)

    def _pump(self) -> None:
        """Send the master's next frame if the line is free."""
        if self.master is None:
            self._line_due_s = math.inf
            return
        frame = self.master.next_frame(self.now_s)
        if frame is not None:
            self.line.send(frame, self.now_s)
        else:
            self._line_due_s = max(self.master.next_due_s(self.now_s), self.now_s + _LINE_RETRY_S)

    def _step(self) -> None:
        self._steps += 1
        now_s, dt_s = self.now_s, self.step_s
        if self.before_step is not None:
            self.before_step(now_s)
        if self.master is None and now_s >= self._boot_at_s:
            self._boot()
        master = self.master
        self._advance_accumulator(dt_s)
        self.board.sense_voltages(self.accumulator)
        if now_s >= self._slow_due_s - _ROUNDING_S:
            self._slow_due_s = now_s + SLOW_PERIOD_S
            self.board.sense_temperatures(self.accumulator)
            self._wants_drive = self.load.state(self.load_time_s).is_high_voltage_on
        self.board.chain.watch(now_s)
        if master is None:
            self._step_charger(dt_s, is_connected=False)
            return
        master.is_can_off = self.master_on_bus.is_held_off or self.bus.is_off(self.master_on_bus)
        if self.babbler.share:
            self.babbler.step(self.bus, now_s, dt_s)
        master.drive_requested = self._wants_drive
        master.is_shutdown_closed = not self.is_shutdown_open
        master.measure(now_s, dt_s, self.current_a)
        self._step_charger(dt_s, is_connected=master.relay_state == RelayState.CHARGER)
        for frame in master.can_sent():
            self.bus.send(self.master_on_bus, frame, now_s)
        if master.reset_due_s is not None and now_s >= master.reset_due_s:
            self.reset(COMMANDED)

    def _advance_accumulator(self, dt_s: float) -> None:
        master = self.master
        relays = RelayState.OPEN if master is None else master.relay_state
        self._draw(dt_s, relays)
        outputs = self.board.chain.take_bleeding(dt_s)
        balance = Balance() if outputs is None else self._balancing.drive(outputs, self.accumulator, dt_s)
        self.accumulator.step(
            dt_s,
            self.current_a,
            bleeding=balance.bleeding,
            cell_current_a=balance.cell_current_a,
            balancer_heat_w=balance.heat_w,
            fan_duty=0.0 if master is None else master.fan_duty,
        )

    def _step_charger(self, dt_s: float, *, is_connected: bool) -> None:
        charger = self.charger
        if not charger.is_plugged:
            charger.unit.current_a = 0.0
            return
        status = charger.unit.step(dt_s, self.accumulator.outlet_voltage_v if is_connected else 0.0)
        if status is not None:
            self.bus.send(charger, CanFrame(STATUS_ID, True, status), self.now_s)
