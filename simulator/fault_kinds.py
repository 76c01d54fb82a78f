"""The faults that can be injected, as a table: name, target, value, and what it does to the simulation."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from operator import attrgetter, not_
from typing import Any

import numpy as np

from simulator.inputs import read_choice
from simulator.simulation import Simulation
from simulator.vehicle import BROWN_OUT, WATCHDOG, Vehicle


class Target(Enum):
    """The part that a fault hits."""

    NONE = "none"
    CELL = "cell"
    PACK = "pack"


_SHORT_REFERENCE_V = 3.6
Apply = Callable[[Any, int, float], None]  # a Vehicle; those of the team's own battery alone want its Simulation


@dataclass(frozen=True, slots=True)
class FaultKind:
    """One kind of fault; `apply` with `neutral` removes it."""

    name: str
    meaning: str
    target: Target
    unit: str
    minimum: float
    maximum: float
    default: float
    neutral: float
    apply: Apply
    is_instant: bool = False  # over as soon as it has happened
    is_whole: bool = False  # only whole numbers are values
    area: str = ""  # area of the car
    is_of_team: bool = False  # batteries that send by a DBC have nothing that it breaks


def _set(path: str, of: Callable[[float], object] = float) -> Apply:
    """Set one value of a part of the simulation."""

    def apply(simulation: Vehicle, _: int, value: float) -> None:
        *owner, name = path.rsplit(".", 1)
        setattr(attrgetter(*owner)(simulation) if owner else simulation, name, of(value))

    return apply


def _each(path: str, of: Callable[[float], object] = float) -> Apply:
    """Set the value of one cell or pack."""

    def apply(simulation: Vehicle, target: int, value: float) -> None:
        attrgetter(path)(simulation)[target] = of(value)

    return apply


def _internal_short(simulation: Vehicle, cell: int, amperes: float) -> None:
    simulation.accumulator.short_s[cell] = amperes / _SHORT_REFERENCE_V


def _joint(simulation: Vehicle, cell: int, milliohm: float) -> None:
    simulation.accumulator.extra_joint_ohm[cell] = milliohm * 1e-3


def _open_wire(simulation: Vehicle, cell: int, is_open: float) -> None:
    wires = simulation.board.open_wires
    wires.add(cell) if is_open else wires.discard(cell)


def _stuck_voltage(simulation: Vehicle, cell: int, volts: float) -> None:
    simulation.board.cell_inputs.stuck_v[cell] = volts
    simulation.board.cell_inputs.faults_changed()


def _noisy_voltage(simulation: Vehicle, cell: int, volts: float) -> None:
    simulation.board.cell_inputs.extra_noise_v[cell] = volts
    simulation.board.cell_inputs.faults_changed()


def _ambient(simulation: Vehicle, _: int, degc: float) -> None:
    simulation.set_ambient(None if np.isnan(degc) else degc)


def _slave(simulation: Vehicle, pack: int, is_lost: float) -> None:
    simulation.board.set_powered(pack, not is_lost)


def _converter(simulation: Simulation, pack: int, bit: float) -> None:
    simulation.board.chain.converters.stick(pack, 0 if np.isnan(bit) else 1 << int(bit))


def _reference(simulation: Vehicle, pack: int, percent: float) -> None:
    simulation.board.drift(pack, 1 + percent / 100)


def _eeprom(simulation: Simulation, _: int, is_worn: float) -> None:
    simulation.board.eeprom.worn_pages = set(range(16)) if is_worn else set()


def _watchdog(simulation: Vehicle, _: int, off_s: float) -> None:
    simulation.reset(WATCHDOG, off_s)


def _brown_out(simulation: Vehicle, _: int, off_s: float) -> None:
    simulation.reset(BROWN_OUT, off_s)


_NAN, _INFINITE = float("nan"), float("inf")
_ON = ("", 1, 1, 1, 0)  # unit, minimum, maximum, default, neutral of a fault that is there or not
_CELL, _PACK, _NONE = Target.CELL, Target.PACK, Target.NONE
_Kind = FaultKind
_AREAS = {
    "cells and sensors": (
        _Kind("sense-wire-open", "sense wire at the cell's upper end disconnected", _CELL, *_ON, _open_wire),
        _Kind(
            *("cell-voltage-stuck", "voltage channel stuck at this value", _CELL, "V", 0, 6, 0, _NAN),
            _stuck_voltage,
        ),
        _Kind("cell-voltage-noisy", "noise on the voltage channel", _CELL, "V rms", 0, 2, 0.02, 0, _noisy_voltage),
        _Kind(
            *("temperature-sensor-fault", "temperature sensor stuck at this value", _CELL, "degC", -60, 200, 60, _NAN),
            _each("board.cell_inputs.temperature_stuck_degc"),
        ),
        _Kind(
            *("temperature-sensor-open", "temperature sensor disconnected", _CELL, *_ON),
            _each("board.cell_inputs.temperature_unplugged", bool),
        ),
        _Kind("joint-resistance-high", "added resistance of the busbar joint", _CELL, "mohm", 0, 50, 2, 0, _joint),
        _Kind(
            "capacity-low", "remaining capacity", _CELL, "of new", 0.05, 1, 0.7, 1, _each("accumulator.capacity_factor")
        ),
        _Kind(
            *("cell-resistance-high", "internal resistance", _CELL, "times new", 1, 20, 2, 1),
            _each("accumulator.resistance_factor"),
        ),
        _Kind(
            *("self-discharge-high", "internal short that draws this at 3.6 V", _CELL, "A", 0, 50, 5, 0),
            _internal_short,
        ),
        _Kind("external-heating", "external heating", _CELL, "W", 0, 500, 50, 0, _each("accumulator.heat_w")),
    ),
    "air": (
        _Kind(
            *("cooling-failed", "share of the airflow that is blocked", _NONE, "", 0, 1, 1, 0),
            _set("accumulator.fan_blocked"),
        ),
        _Kind("ambient-temperature", "ambient temperature", _NONE, "degC", -40, 80, 45, _NAN, _ambient),
    ),
    "slaves": (
        _Kind("slave-lost", "slave board does not respond", _PACK, *_ON, _slave),
        _Kind(
            *("slave-adc-fault", "ADC bit of the slave that is stuck", _PACK, "", 0, 15, 7, _NAN, _converter),
            is_whole=True,
        ),
        _Kind("slave-reference-drift", "error of the slave's voltage reference", _PACK, "%", -20, 20, 2, 0, _reference),
        _Kind(
            *("slave-multiplexer-fault", "slave multiplexer fails its self-test", _PACK, *_ON),
            _each("board.chain.converters.multiplexer_failed", bool),
        ),
        _Kind(
            *("isospi-noise", "bit errors on the isoSPI line", _NONE, "per bit", 0, 0.1, 1e-3, 0),
            _set("board.chain.bit_error_rate"),
        ),
    ),
    "current and contactors": (
        _Kind(
            *("current-sensor-open", "current sensor disconnected", _NONE, *_ON),
            _set("board.current_sensor.is_unplugged", bool),
        ),
        _Kind(
            *("current-sensor-offset", "offset of the current sensor", _NONE, "A", -400, 400, 2, 0),
            _set("board.current_sensor.extra_offset_a"),
        ),
        _Kind(
            *("external-shutdown", "a shutdown button or the IMD opens the contactors", _NONE, *_ON),
            _set("is_shutdown_open", bool),
        ),
        _Kind(
            *("precharge-failed", "pre-charge resistor burnt out", _NONE, *_ON),
            _set("link.is_precharge_open", bool),
        ),
        _Kind(
            *("dc-link-load", "load on the DC link", _NONE, "ohm", 100, 1e6, 2000, _INFINITE),
            _set("link.leak_ohm"),
        ),
        _Kind(
            *("dc-link-discharge-failed", "DC link stays charged when the contactors open", _NONE, *_ON),
            _set("link.is_discharge_open", bool),
        ),
    ),
    "master": (
        _Kind("eeprom-worn", "EEPROM does not keep the configuration", _NONE, *_ON, _eeprom),
        _Kind(
            *("master-watchdog-reset", "watchdog resets the master", _NONE, "s off", 0, 60, 0.3, 0),
            _watchdog,
            is_instant=True,
        ),
        _Kind(
            "master-supply-lost", "master loses its supply", _NONE, "s off", 0, 60, 1, 0, _brown_out, is_instant=True
        ),
    ),
    "RS232": (
        _Kind(
            *("serial-noise", "bit errors on RS232", _NONE, "per byte", 0, 1, 1e-3, 0),
            _set("line.noise_per_byte"),
        ),
        _Kind("serial-drop-outs", "truncated frames on RS232", _NONE, *_ON, _set("line.is_dropping", bool)),
        _Kind("serial-silent", "RS232 interrupted", _NONE, *_ON, _set("line.is_stuck", bool)),
    ),
    "CAN": (
        _Kind(
            *("can-master-bus-off", "CAN controller of the master bus-off", _NONE, *_ON),
            _set("master_on_bus.is_held_off", bool),
        ),
        _Kind("can-short", "short circuit on the CAN bus", _NONE, *_ON, _set("bus.is_broken", bool)),
        _Kind(
            *("can-noise", "bit errors on the CAN bus", _NONE, "per bit", 0, 0.1, 1e-3, 0),
            _set("bus.noise_per_bit"),
        ),
        _Kind(
            *("can-babbling-node", "bus load of a node with the highest priority", _NONE, "", 0, 1, 0.9, 0),
            _set("babbler.share"),
        ),
    ),
    "charger": (
        _Kind(
            *("charger-over-temperature", "added heat in the charger", _NONE, "W", 0, 5000, 2500, 0),
            _set("charger.unit.extra_heat_w"),
        ),
        _Kind(
            *("charger-input-voltage", "no mains at the charger", _NONE, *_ON),
            _set("charger.unit.has_mains", not_),
        ),
        _Kind(
            *("charger-no-battery", "charger polarity reversed", _NONE, *_ON),
            _set("charger.unit.is_reversed", bool),
        ),
        _Kind(
            *("charger-silent", "charger does not communicate", _NONE, *_ON),
            _set("charger.unit.is_silent", bool),
        ),
        _Kind(
            *("charger-hardware-fault", "charger reports a hardware fault", _NONE, *_ON),
            _set("charger.unit.has_hardware_fault", bool),
        ),
    ),
}
_OF_TEAM = (
    *("slave-adc-fault", "slave-multiplexer-fault", "isospi-noise", "eeprom-worn"),
    *("serial-noise", "serial-drop-outs", "serial-silent"),
)
FAULTS: dict[str, FaultKind] = {
    kind.name: replace(kind, area=area, is_of_team=kind.name in _OF_TEAM)
    for area, kinds in _AREAS.items()
    for kind in kinds
}
_FORMERLY = {  # names that scenarios and programs of earlier versions have
    "loose-joint": "joint-resistance-high",
    "weak-cell": "capacity-low",
    "high-resistance": "cell-resistance-high",
    "internal-short": "self-discharge-high",
    "hot-cell": "external-heating",
    "stuck-sensor": "cell-voltage-stuck",
    "noisy-sensor": "cell-voltage-noisy",
    "open-wire": "sense-wire-open",
    "stuck-temperature": "temperature-sensor-fault",
    "temperature-unplugged": "temperature-sensor-open",
    "ambient": "ambient-temperature",
    "blocked-fan": "cooling-failed",
    "lost-slave": "slave-lost",
    "broken-converter": "slave-adc-fault",
    "drifting-reference": "slave-reference-drift",
    "multiplexer-failed": "slave-multiplexer-fault",
    "current-offset": "current-sensor-offset",
    "current-unplugged": "current-sensor-open",
    "shutdown-open": "external-shutdown",
    "precharge-open": "precharge-failed",
    "link-leak": "dc-link-load",
    "discharge-open": "dc-link-discharge-failed",
    "reset": "master-watchdog-reset",
    "brown-out": "master-supply-lost",
    "serial-stuck": "serial-silent",
    "can-bus-off": "can-master-bus-off",
    "can-broken": "can-short",
    "can-babble": "can-babbling-node",
    "charger-hot": "charger-over-temperature",
    "charger-no-mains": "charger-input-voltage",
    "charger-reversed": "charger-no-battery",
    "charger-broken": "charger-hardware-fault",
}


def read_fault(table: Mapping[str, Any], key: str) -> FaultKind:
    """Return the kind of fault that a table names, by its name or an earlier one.

    Raises:
        InputError: it names none.
    """
    given = {name: today(value) if name == key and isinstance(value, str) else value for name, value in table.items()}
    return FAULTS[read_choice(given, key, FAULTS)]


def today(name: str) -> str:
    """Return today's name of a fault."""
    return _FORMERLY.get(name, name)
