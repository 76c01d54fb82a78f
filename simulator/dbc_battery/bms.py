"""An ordinary BMS between a boot and a reset: protects, closes relays, charges, balances, counts charge.

It reads its board's sensors, never the true state of a cell, and hands out readings; how they are spoken is not its.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from firmware_protocol.elcon import ChargerCommand
from firmware_protocol.messages import CommandId, EventCode
from simulator.bms_state import ChargingState, Latch, RelayState
from simulator.cell_data import BoolArray, FloatArray
from simulator.charger_unit import ChargerUnit
from simulator.dbc_battery.battery import DbcBattery, Readings
from simulator.dbc_battery.sensor_board import SensorBoard
from simulator.vehicle import SOC_SCALE

FAST_PERSISTENCE_S = 0.3
SLOW_PERSISTENCE_S = 0.4
WIRE_PERSISTENCE_S = 0.5  # a lost measurement has no time in the rules
SENSOR_PERSISTENCE_S = 1.0  # persistence of a temperature violation


class Violation(NamedTuple):
    """A value beyond its limit, or a measurement that is missing."""

    code: EventCode
    persistence_s: float


class Protection:
    """The OK signal: switched off by a violation that persists, stays off until cleared."""

    def __init__(self, latch: Latch) -> None:
        self._latch = latch
        self._since_s: dict[EventCode, float] = {}

    @property
    def is_ok(self) -> bool:
        """The OK signal."""
        return not self._latch.is_open

    def judge(self, violations: Iterable[Violation], now_s: float) -> None:
        """Take this pass's violations."""
        critical = tuple(violations)
        self._since_s = {violation.code: self._since_s.get(violation.code, now_s) for violation in critical}
        for code, persistence_s in critical:
            # a microsecond of slack: times are sums of steps
            if now_s - self._since_s[code] >= persistence_s - 1e-6:
                self._latch.is_open = True

    def clear(self) -> bool:
        """Release the latch unless a limit is violated now; return whether it was released."""
        if not self._since_s:
            self._latch.is_open = False
        return not self._since_s


PRECHARGED = 0.95  # share of the accumulator's voltage before the second AIR closes (FS rules EV 5.7.1)
PRECHARGE_LIMIT_S = 3.0  # ten time constants: what is not charged by then never will be


class Relays:
    """Closed only while the OK signal is on; the vehicle is pre-charged first.

    A pre-charge that does not reach its voltage in time opens again, and is tried again only when the driver asks anew
    or faults are cleared: each try heats the resistor.
    """

    def __init__(self) -> None:
        self.state = RelayState.OPEN
        self.has_precharge_failed = False
        self.since_s = 0.0  # in this state

    def step(
        self, now_s: float, *, is_ok: bool, drive_requested: bool, charging: bool, link_share: float
    ) -> RelayState:
        """Advance one pass and return the state; `link_share` is the link's voltage over the accumulator's."""
        if not drive_requested:
            self.has_precharge_failed = False
        if is_ok and charging:
            self._go(RelayState.CHARGER, now_s)
        elif not is_ok or not drive_requested or self.has_precharge_failed:
            self._go(RelayState.OPEN, now_s)
        elif self.state in (RelayState.OPEN, RelayState.CHARGER):
            self._go(RelayState.PRECHARGE, now_s)
        elif self.state is RelayState.PRECHARGE:
            if link_share >= PRECHARGED:
                self._go(RelayState.VEHICLE, now_s)
            elif now_s - self.since_s >= PRECHARGE_LIMIT_S:
                self.has_precharge_failed = True
                self._go(RelayState.OPEN, now_s)
        return self.state

    def retry(self) -> None:
        """Allow another try after a failed pre-charge."""
        self.has_precharge_failed = False

    def _go(self, state: RelayState, now_s: float) -> None:
        if state is not self.state:
            self.state = state
            self.since_s = now_s


READY_S = 0.5
RESET_DELAY_S = 0.1
CHARGE_C_RATE = 0.5
DONE_C_RATE = 0.04
CHARGE_HELD_V = 0.05  # below the trip
BALANCE_FROM_V, BALANCE_UNTIL_V = 0.010, 0.005  # above the lowest cell
_CONTROL_S = 1.0
_FULL_V = 0.004
_REST_A = 0.02  # C: a current below is none, and tells the charge from the voltage
_FAN_FROM_DEGC, _FAN_FULL_DEGC = 30.0, 50.0
_OHM_TIMES_AH = 0.0022 * 25.5  # resistance times capacity of the simulated cell
# what one reads off a data sheet: voltages at rest of a SOC of 0, 5, 10 % and so on
_REST_V = (
    *(2.660, 3.308, 3.406, 3.462, 3.504, 3.553, 3.600, 3.627, 3.652, 3.692, 3.742),
    *(3.790, 3.841, 3.884, 3.926, 3.975, 4.025, 4.058, 4.086, 4.136, 4.194),
)
_REST_SOC = np.linspace(0, 1, len(_REST_V))


class Charge:
    """Constant current until the highest cell is full, then as much as holds it there."""

    def __init__(self, battery: DbcBattery) -> None:
        limits = battery.trip_limits()
        self._most_a = min(CHARGE_C_RATE * battery.capacity_ah, limits.charge_current_max_a)
        self._done_a = DONE_C_RATE * battery.capacity_ah
        self._held_v = limits.cell_voltage_max_v - CHARGE_HELD_V
        self._n_cells = battery.shape.n_cells
        self._asked_a = 0.0
        self._due_s = 0.0
        self.state = ChargingState.OFF

    @property
    def is_active(self) -> bool:
        """It was started and has not ended."""
        return self.state in (ChargingState.CONSTANT_CURRENT, ChargingState.CONSTANT_VOLTAGE)

    def start(self) -> None:
        """Begin."""
        self._asked_a, self.state = self._most_a, ChargingState.CONSTANT_CURRENT

    def stop(self, *, fault: bool = False) -> None:
        """End, if it has begun."""
        if self.is_active:
            self.state = ChargingState.FAULT if fault else ChargingState.OFF

    def step(self, now_s: float, unit: ChargerUnit, highest_v: float) -> None:
        """Trim the current once a second, and say it to the charger."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + _CONTROL_S
        if self.is_active:
            missing_v = self._held_v - highest_v
            if missing_v <= 0.0:
                self.state = ChargingState.CONSTANT_VOLTAGE
            if self.state is ChargingState.CONSTANT_VOLTAGE:
                share = 0.9 if missing_v < 0.0 else 1.02
                self._asked_a = min(max(self._asked_a * share, 0.5 * self._done_a), self._most_a)
                if self._asked_a < self._done_a and missing_v < _FULL_V:
                    self.state = ChargingState.DONE
        volts = self._n_cells * (self._held_v + CHARGE_HELD_V)
        asked_a = self._asked_a if self.is_active else 0.0
        unit.receive(ChargerCommand(volts, asked_a, is_charging=self.is_active).to_bytes())


class Bms:
    """One pass every step; `readings` says what it knows."""

    def __init__(self, battery: DbcBattery, board: SensorBoard, charger: ChargerUnit, now_s: float) -> None:
        self._battery = battery
        self._limits = battery.trip_limits()
        self._board = board
        self._charger = charger
        self._boot_s = now_s
        self._protection = Protection(board.latch)
        self._relays = Relays()
        self.charging = Charge(battery)
        self._is_balancing = False
        self.bleeding: BoolArray = np.zeros(battery.shape.n_cells, dtype=bool)
        self._soc: float | None = None
        self._current_a = 0.0
        self._pack_v = 0.0
        self.drive_requested = False
        self.is_shutdown_closed = True
        self.reset_due_s: float | None = None

    @property
    def relay_state(self) -> RelayState:
        """Return the side that the relays connect the battery to."""
        return self._relays.state

    @property
    def relays_since_s(self) -> float:
        """Return since when they are there [s]."""
        return self._relays.since_s

    @property
    def has_precharge_failed(self) -> bool:
        """The vehicle's link did not reach its voltage in time."""
        return self._relays.has_precharge_failed

    @property
    def fan_duty(self) -> float:
        """Duty of the fans, 0..1."""
        hottest = float(np.nanmax(self._board.temperature_degc, initial=-np.inf))
        return float(np.clip((hottest - _FAN_FROM_DEGC) / (_FAN_FULL_DEGC - _FAN_FROM_DEGC), 0.0, 1.0))

    def measure(self, now_s: float, dt_s: float, true_current_a: float, true_pack_v: float) -> None:
        """Run one pass: measure, protect, charge, balance, set relays."""
        self._current_a = self._board.sense_current_a(true_current_a)
        self._pack_v = true_pack_v
        is_ready = now_s - self._boot_s >= READY_S
        self._count_charge(dt_s)
        if is_ready:
            self._protection.judge(self._violations(), now_s)
        if not self._protection.is_ok:
            self.charging.stop(fault=True)
            self._is_balancing = False
        if self.drive_requested:
            self.charging.stop()
        highest_v = float(np.nanmax(self._board.voltage_v, initial=0.0))
        self.charging.step(now_s, self._charger, highest_v)
        self._balance()
        self._relays.step(
            now_s,
            is_ok=self._protection.is_ok and self.is_shutdown_closed,
            drive_requested=self.drive_requested and is_ready,
            charging=self.charging.is_active,
            link_share=self._board.link_share,
        )

    def readings(self) -> Readings:
        """Return what the BMS knows, by kind; NaN where it has no value."""
        limits, unit = self._limits, self._charger
        relays, is_charging = self._relays.state, self.charging.is_active
        n = self._battery.shape.n_cells
        return {
            "voltage": self._board.voltage_v,
            "temperature": self._board.temperature_degc,
            "balancing": self.bleeding.astype(float),
            "resistance": np.full(n, _OHM_TIMES_AH / self._battery.capacity_ah),
            "current": _one(self._current_a),
            "pack_voltage": _one(self._pack_v),
            "soc": _one(np.nan if self._soc is None else self._soc),
            "charger_voltage": _one(unit.voltage_v),
            "charger_current": _one(-unit.current_a),
            "state.closed": _one(relays in (RelayState.VEHICLE, RelayState.CHARGER)),
            "state.precharge": _one(relays is RelayState.PRECHARGE),
            "state.fault": _one(not self._protection.is_ok),
            "state.charging": _one(is_charging),
            "state.balancing": _one(bool(self.bleeding.any())),
            **{f"limit.{name}": _one(getattr(limits, name)) for name in type(limits).__dataclass_fields__},
            "limit.pack_voltage_max_v": _one(n * limits.cell_voltage_max_v),
            "limit.segment_voltage_max_v": _one(max(self._battery.shape.packs) * limits.cell_voltage_max_v),
        }

    def command(self, command: CommandId, argument: int, now_s: float) -> bool:
        """Carry out a command; return False where the state forbids it, or it is one of the team's master only."""
        is_driving = self.relay_state in (RelayState.VEHICLE, RelayState.PRECHARGE)
        is_free = not is_driving and not self.drive_requested and self._protection.is_ok
        match command:
            case CommandId.CHARGE_START if is_free:
                self.charging.start()
            case CommandId.CHARGE_STOP:
                self.charging.stop()
            case CommandId.BALANCE_START if is_free and not self.charging.is_active:
                self._is_balancing = True
            case CommandId.BALANCE_STOP:
                self._is_balancing = False
            case CommandId.CLEAR_FAULTS if self._protection.clear():
                self._relays.retry()
            case CommandId.SET_SOC:
                self._soc = argument / SOC_SCALE
            case CommandId.RESET if not is_driving:
                self.reset_due_s = now_s + RESET_DELAY_S
            case _:
                return False
        return True

    def store_config(self, now_s: float) -> bool:
        """There is no configuration to store."""
        return False

    def lose_power(self, rng: np.random.Generator) -> None:
        """Nothing is under way that a loss of power would break."""

    def _count_charge(self, dt_s: float) -> None:
        volts, capacity_ah = self._board.voltage_v, self._battery.capacity_ah
        if self._soc is not None:
            self._soc = min(max(self._soc - self._current_a * dt_s / (3600.0 * capacity_ah), 0.0), 1.0)
        elif abs(self._current_a) < _REST_A * capacity_ah and np.isfinite(volts).any():
            self._soc = float(np.interp(np.nanmean(volts), _REST_V, _REST_SOC))

    def _violations(self) -> Iterator[Violation]:
        limits, board = self._limits, self._board
        volts, degc = board.voltage_v, board.temperature_degc
        yield from _outside(
            volts, limits.cell_voltage_min_v, limits.cell_voltage_max_v, FAST_PERSISTENCE_S,
            (EventCode.TRIP_V_MIN, EventCode.TRIP_V_MAX),
        )  # fmt: skip
        yield from _outside(
            degc, limits.temperature_min_degc, limits.temperature_max_degc, SLOW_PERSISTENCE_S,
            (EventCode.TRIP_T_MIN, EventCode.TRIP_T_MAX),
        )  # fmt: skip
        code = EventCode.TRIP_I_CHRG if self.charging.is_active else EventCode.TRIP_I_DISC
        if not -limits.charge_current_max_a <= self._current_a <= limits.discharge_current_max_a:
            yield Violation(code, FAST_PERSISTENCE_S)
        if np.isnan(volts).any():
            yield Violation(EventCode.TRIP_SENSOR_LOST, WIRE_PERSISTENCE_S)
        elif np.isnan(degc).any():
            yield Violation(EventCode.TRIP_SENSOR_LOST, SENSOR_PERSISTENCE_S)

    def _balance(self) -> None:
        """Bleed what stands above the lowest cell, with some hysteresis, while asked or charging."""
        if not (self._is_balancing or self.charging.is_active):
            self.bleeding[:] = False
            return
        volts = self._board.voltage_v
        above_v = volts - np.nanmin(volts, initial=np.inf)
        self.bleeding = (above_v > BALANCE_FROM_V) | (self.bleeding & (above_v > BALANCE_UNTIL_V))
        self._is_balancing = self._is_balancing and bool(self.bleeding.any())


def _one(value: float) -> FloatArray:
    return np.array([float(value)])


def _outside(
    values: FloatArray, low: float, high: float, persistence_s: float, codes: tuple[EventCode, EventCode]
) -> Iterator[Violation]:
    if values.size and np.nanmin(values, initial=np.inf) < low:
        yield Violation(codes[0], persistence_s)
    if values.size and np.nanmax(values, initial=-np.inf) > high:
        yield Violation(codes[1], persistence_s)
