"""The car around a simulated BMS: cells, load, link capacitor, charger, CAN bus, virtual time.

Who inherits adds the BMS and what it measures with, and advances both. No wall clock and no ports here.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from firmware_protocol.messages import CommandId
from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.bms_state import ChargingState, RelayState
from simulator.bus_nodes import BabblingNode, CarUnits, ChargerOnBus
from simulator.can_bus import CanBus
from simulator.charger_unit import ChargerParameters, ChargerUnit
from simulator.loads import Load, Rest
from simulator.shape import TEAM, Shape


@dataclass(frozen=True)
class LinkParameters:
    """Link circuit of a car with two inverters; 0.3 s to charge, below 60 V 2.9 s after opening (rules: 5 s)."""

    capacitance_f: float = 500e-6
    precharge_ohm: float = 600.0
    discharge_ohm: float = 3000.0  # switched in while the relays are open


class LinkCircuit:
    """One capacitor. Faults to be set: `leak_ohm`, `is_precharge_open`, `is_discharge_open`."""

    def __init__(self, parameters: LinkParameters | None = None) -> None:
        self.parameters = parameters or LinkParameters()
        self.voltage_v = 0.0
        self.leak_ohm = math.inf  # across the capacitor: wet connector, a load that is on too early
        self.is_precharge_open = False
        self.is_discharge_open = False

    def step(self, dt_s: float, source_v: float, relays: RelayState) -> float:
        """Advance by `dt_s` > 0 [s] and return the mean current out of the accumulator [A].

        Into C over R from V, with a leak L across C: V settles at V L / (R + L) with the time constant C R L / (R + L).
        """
        leak_s = 1.0 / self.leak_ohm
        if relays is RelayState.VEHICLE:
            self.voltage_v = source_v
            return source_v * leak_s
        is_charging = relays is RelayState.PRECHARGE and not self.is_precharge_open
        is_discharging = relays is not RelayState.PRECHARGE and not self.is_discharge_open
        feed_s = 1.0 / self.parameters.precharge_ohm if is_charging else 0.0
        total_s = leak_s + feed_s + (1.0 / self.parameters.discharge_ohm if is_discharging else 0.0)
        if not total_s:
            return 0.0
        settled_v = source_v * feed_s / total_s
        exponent = dt_s * total_s / self.parameters.capacitance_f
        away_v = self.voltage_v - settled_v
        self.voltage_v = settled_v + away_v * math.exp(-exponent)
        mean_v = settled_v + away_v * -math.expm1(-exponent) / exponent
        return (source_v - mean_v) * feed_s


PASS_S = 0.02
BOOT_S = 0.3
SOC_SCALE = 10_000  # the argument of SET_SOC is in 0.01 %
POWER_ON, WATCHDOG, BROWN_OUT, COMMANDED = range(4)  # reset causes


class ChargeState(Protocol):
    """The state of a charge."""

    @property
    def is_active(self) -> bool:
        """Charging was started and has not ended."""
        ...

    @property
    def state(self) -> ChargingState:
        """Its stage."""
        ...


class Operated(Protocol):
    """A BMS between a boot and a reset, as its operator and the scenario see it."""

    @property
    def relay_state(self) -> RelayState:
        """Return the side that the relays connect the accumulator to."""
        ...

    @property
    def relays_since_s(self) -> float:
        """Return since when they are there [s]."""
        ...

    @property
    def has_precharge_failed(self) -> bool:
        """The vehicle's link did not reach its voltage in time."""
        ...

    @property
    def charging(self) -> ChargeState:
        """Return the state of its charger."""
        ...

    def command(self, command: CommandId, argument: int, now_s: float) -> bool:
        """Carry out a command; return False where the state forbids it."""
        ...

    def store_config(self, now_s: float) -> bool:
        """Store the configuration in force; return False where there is none to store."""
        ...

    def lose_power(self, rng: np.random.Generator) -> None:
        """Lose power."""
        ...


class Vehicle:
    """A battery, driving or on its charger."""

    shape: Shape = TEAM
    board: Any  # what the BMS measures with: `cell_inputs`, `current_sensor`, `open_wires`, `set_powered`, `drift`
    master_on_bus: Any  # its node, with `bit_rate` and `is_held_off`

    def __init__(
        self,
        parameters: AccumulatorParameters,
        *,
        seed: int,
        step_s: float,
        charger: ChargerParameters | None = None,
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.step_s = step_s
        self.accumulator = Accumulator(parameters, self.rng)
        self.charger = ChargerOnBus(ChargerUnit(charger, ambient_degc=parameters.ambient_degc))
        self.babbler = BabblingNode(lambda: int(self.master_on_bus.bit_rate))
        self.units = CarUnits(lambda: int(self.master_on_bus.bit_rate))
        self.bus = CanBus(self.rng)
        self.link = LinkCircuit()
        self.serial_out: Callable[[bytes], None] | None = None
        self.before_step: Callable[[float], None] | None = None
        self.load: Load = Rest()
        self._load_start_s = 0.0
        self.now_s = 0.0
        self._steps = 0
        self._boot_at_s = 0.0
        self._boot_cause = POWER_ON
        self.current_a = 0.0
        self.is_shutdown_open = False
        self._ambient_degc: float | None = None

    @property
    def operated(self) -> Operated | None:
        """The BMS while it runs."""
        raise NotImplementedError

    def set_load(self, load: Load) -> None:
        """Connect another load and start it."""
        self.load = load
        self._load_start_s = self.now_s

    def set_ambient(self, degc: float | None) -> None:
        """Set the air temperature, or with None the one of the scenario."""
        if self._ambient_degc is None:
            self._ambient_degc = self.accumulator.ambient_degc
        self.accumulator.ambient_degc = self.charger.unit.ambient_degc = self._ambient_degc if degc is None else degc

    @property
    def load_time_s(self) -> float:
        """Return how long the load has been on [s]."""
        return self.now_s - self._load_start_s

    def next_due_s(self) -> float:
        """Return the next instant at which something happens by itself [s]."""
        raise NotImplementedError

    def run_until(self, until_s: float) -> None:
        """Advance to an instant, everything due until then included."""
        raise NotImplementedError

    def receive(self, data: bytes) -> None:
        """Take bytes that reach the BMS's RS232 line now; most have none."""

    def reset(self, cause: int, off_s: float = BOOT_S) -> None:
        """Power the BMS off, or restart it; it boots after `off_s`."""
        if self.operated is not None:
            self.operated.lose_power(self.rng)
        self._switch_off()
        self._boot_at_s = self.now_s + off_s
        self._boot_cause = cause

    def _switch_off(self) -> None:
        raise NotImplementedError

    def _draw(self, dt_s: float, relays: RelayState) -> None:
        """Find the current of the next step, and what the pre-charge board compares."""
        source_v = self.accumulator.outlet_voltage_v
        self.current_a = self.link.step(dt_s, source_v, relays)
        self.board.link_share = self.link.voltage_v / source_v if source_v > 0 else 0.0
        if relays == RelayState.VEHICLE:
            self.current_a += self._load_a()
        elif relays == RelayState.CHARGER:
            self.current_a = -self.charger.unit.current_a

    def _load_a(self) -> float:
        return self.load.current_a(self.load_time_s, self.accumulator)
