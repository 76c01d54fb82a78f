"""A battery with a DBC in virtual time: physics, its BMS, its frames on the bus."""

import math

from firmware_protocol.memory_map import CAN_ID_EXTENDED
from simulator.accumulator import AccumulatorParameters
from simulator.bms_state import RelayState
from simulator.can_bus import CanFrame
from simulator.cell_data import FloatArray
from simulator.dbc_battery.battery import DbcBattery
from simulator.dbc_battery.bms import Bms
from simulator.dbc_battery.sensor_board import SensorBoard
from simulator.loads import ConstantCurrent, ElectricalView, Pattern, Recorded
from simulator.simulation import SLOW_PERIOD_S
from simulator.vehicle import COMMANDED, PASS_S, Vehicle

_MAX_WAITING = 4096  # frames of one BMS


class BmsOnBus:
    """The BMS's controller; off while it does not run or is held off by a fault."""

    is_listening_only = False

    def __init__(self, simulation: "BatterySimulation") -> None:
        self._simulation = simulation
        self.is_held_off = False
        self.rate = simulation.battery.bit_rate

    @property
    def bit_rate(self) -> int:
        """Return the bit rate of the bus [bit/s]."""
        return 0 if self._simulation.bms is None or self.is_held_off else self.rate

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Ignore every frame: no DBC says which a BMS obeys."""


class _AsOfTeam:
    """The voltage that the team's own battery would have with these cells: cars are made for it."""

    def __init__(self, view: ElectricalView, share: float) -> None:
        self.outlet_voltage_v = view.outlet_voltage_v / share


class BatterySimulation(Vehicle):
    """One battery, driving or on its charger."""

    board: SensorBoard
    master_on_bus: BmsOnBus

    def __init__(
        self, parameters: AccumulatorParameters, battery: DbcBattery, *, seed: int = 0, step_s: float = PASS_S
    ) -> None:
        super().__init__(battery.built_as(parameters), seed=seed, step_s=step_s, charger=battery.charger())
        self.battery = battery
        self.shape = battery.shape
        self.board = SensorBoard(battery, self.rng)
        self.master_on_bus = BmsOnBus(self)
        self.bus.attach(self.master_on_bus, _MAX_WAITING)
        if not battery.is_alone:
            self.bus.attach(self.units)
        self.bus.attach(self.babbler, _MAX_WAITING)
        self._slow_due_s = 0.0
        self.bms: Bms | None = None
        self._boot()

    @property
    def operated(self) -> Bms | None:
        """The BMS while it runs."""
        return self.bms

    def next_due_s(self) -> float:
        """Return the next instant at which something happens by itself [s]."""
        due_s = min(self._steps * self.step_s, self.bus.due_s)
        if self.bms is None:
            return due_s
        serial_s = math.inf if self.battery.serial is None else self.battery.serial.due_s
        return min(due_s, self.battery.voice.due_s, max(serial_s, self.now_s))

    def receive(self, data: bytes) -> None:
        """Take bytes that reach the BMS's serial line now."""
        if self.bms is not None and self.battery.serial is not None:
            self.battery.serial.receive(data, self.now_s)

    def run_until(self, until_s: float) -> None:
        """Advance to an instant, everything due until then included."""
        voice = self.battery.voice
        while (due_s := self.next_due_s()) <= until_s:
            self.now_s = now_s = max(self.now_s, due_s)
            if self._steps * self.step_s <= now_s:
                self._step()
            if self.bms is not None and voice.due_s <= now_s:
                for can_id, data in voice.frames(now_s, self.bms.readings()):
                    is_extended = bool(can_id & CAN_ID_EXTENDED)
                    frame = CanFrame(can_id & ~CAN_ID_EXTENDED, is_extended, data)
                    self.bus.send(self.master_on_bus, frame, now_s)
            self._send_serial(now_s)
            if self.bus.due_s <= now_s:
                self.bus.run(now_s)
        self.now_s = max(self.now_s, until_s)

    def _send_serial(self, now_s: float) -> None:
        serial = self.battery.serial
        if self.bms is None or serial is None or serial.due_s > now_s:
            return
        data = serial.bytes_due(now_s, self.bms.readings())
        if data and self.serial_out is not None:
            self.serial_out(data)

    def _boot(self) -> None:
        self.bms = Bms(self.battery, self.board, self.charger.unit, self.now_s)
        self.battery.voice.begin(self.now_s)
        if self.battery.serial is not None:
            self.battery.serial.begin(self.now_s)

    def _switch_off(self) -> None:
        self.bms = None

    def _step(self) -> None:
        self._steps += 1
        now_s, dt_s = self.now_s, self.step_s
        if self.before_step is not None:
            self.before_step(now_s)
        if self.bms is None and now_s >= self._boot_at_s:
            self._boot()
        bms = self.bms
        relays = RelayState.OPEN if bms is None else bms.relay_state
        self._draw(dt_s, relays)
        bleeding: FloatArray | None = None if bms is None else bms.bleeding.astype(float)
        self.accumulator.step(
            dt_s, self.current_a, bleeding=bleeding, fan_duty=0.0 if bms is None else bms.fan_duty
        )  # fmt: skip
        self.board.sense_voltages(self.accumulator)
        if now_s >= self._slow_due_s:
            self._slow_due_s = now_s + SLOW_PERIOD_S
            self.board.sense_temperatures(self.accumulator)
        is_connected = relays is RelayState.CHARGER
        if self.charger.is_plugged:
            self.charger.unit.step(dt_s, self.accumulator.outlet_voltage_v if is_connected else 0.0)
        else:
            self.charger.unit.current_a = 0.0
        if self.babbler.share:
            self.babbler.step(self.bus, now_s, dt_s)
        if bms is None:
            return
        bms.drive_requested = self.load.state(self.load_time_s).is_high_voltage_on
        bms.is_shutdown_closed = not self.is_shutdown_open
        bms.measure(now_s, dt_s, self.current_a, self.accumulator.voltage_v)
        if bms.reset_due_s is not None and now_s >= bms.reset_due_s:
            self.reset(COMMANDED)

    def _load_a(self) -> float:
        """What the load asks for; a car is one of the team's with as much power a cell, and current by capacity."""
        load, t_s = self.load, self.load_time_s
        if isinstance(load, ConstantCurrent | Pattern | Recorded):
            return load.current_a(t_s, self.accumulator)
        view = _AsOfTeam(self.accumulator, self.battery.share_of_team)
        return load.current_a(t_s, view) * self.battery.size
