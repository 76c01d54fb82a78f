"""Sizing: voltage, charge, energy, mass, currents, power and resistance of a battery before it is built.

From a cell file and a layout of n cells in series and p in parallel, all of them alike:

    U = n u     I = p i     Q = p q     R = r n / p     E, m and P = n p times the cell's

What the cell file does not say is missing in the result, by the name of its field; nothing is put in its place.
Joints between cells, fuses, cables and the case are not in a cell file, so neither in the resistance nor in the mass.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.prediction.constant_current import (
    CellKnowledge,
    OperatingPoint,
    carry_forward,
    is_beyond_measured,
    measured_current_a,
)
from app.estimation.prediction.power import PowerLimit, PowerModel
from app.estimation.prediction.power_along import limits_of

PULSE_S: Final = 10.0
OCV_POINTS: Final = 1000  # points of the mean over SOC
BISECTIONS: Final = 40
MEGA: Final = 1e6

Kind = Literal["voltage", "current", "each", "resistance"]  # how it grows with the cells
Direction = Literal["discharge", "charge"]


@dataclass(frozen=True, slots=True)
class CellLayout:
    """Packs in series, cells in series in each, and how many of what the cell file describes are in parallel."""

    n_segments: int
    n_in_series: int
    n_parallel: int = 1


@dataclass(frozen=True, slots=True)
class Figure:
    """One number of a battery: of what the cell file describes, of a pack and of the whole, in the same unit.

    Attributes:
        name: with its unit at the end, as `capacity_ah`.
        title: in words.
        unit: as it is written.
        condition: under which it holds.
        cell, pack, battery: None where the cell file does not say what is needed.
        missing: the fields of the cell file that would be needed.
    """

    name: str
    title: str
    unit: str
    condition: str
    cell: float | None
    segment: float | None
    battery: float | None
    missing: tuple[str, ...] = ()


def figures_of(
    cell: CellModel, layout: CellLayout, soc: float = 0.5, temperature_degc: float = 25.0
) -> Mapping[str, Figure]:
    """Return the figures of a battery by name, in the order in which a person reads them.

    Args:
        cell: model of what is put in series and in parallel: a cell, or a module of cells.
        layout: how many.
        soc: state of charge for which power and resistance hold.
        temperature_degc: temperature of all cells for which they hold [degC].
    """
    made = _Maker(layout)
    nominal_wh = None if cell.v_nominal_v is None else cell.v_nominal_v * cell.capacity_ah
    no_nominal, no_mass = _without(cell.v_nominal_v, "v_nominal_v"), _without(cell.mass_kg, "mass_kg")
    made.add("voltage_nominal_v", "voltage, nominal", "V", "voltage", cell.v_nominal_v, "by the cell file", no_nominal)
    made.add("voltage_max_v", "voltage, highest", "V", "voltage", cell.v_max_v, "charged to the cell file's limit")
    made.add("voltage_min_v", "voltage, lowest", "V", "voltage", cell.v_min_v, "discharged to the cell file's limit")
    made.add("capacity_ah", "capacity", "Ah", "current", cell.capacity_ah, "of the cell file, SOC 1 to 0")
    made.add(
        "energy_nominal_mj", "energy, nominal", "MJ", "each", _megajoule(nominal_wh),
        "nominal voltage times capacity", no_nominal,
    )  # fmt: skip
    made.add(
        "energy_ocv_mj", "energy without load", "MJ", "each", _megajoule(_ocv_wh(cell, temperature_degc)),
        f"open-circuit voltage over SOC 1 to 0 at {temperature_degc:g} degC; every current leaves less",
    )  # fmt: skip
    made.add("mass_kg", "mass of the cells", "kg", "each", cell.mass_kg, "without case, joints, electronics", no_mass)
    made.add("current_1c_a", "current, 1C", "A", "current", cell.c_rate_a, "empties the cells in an hour")
    at = _At(cell, soc, temperature_degc)
    for direction, limit_a in (("discharge", cell.limits.discharge_max_a), ("charge", cell.limits.charge_max_a)):
        _add_direction(made, at, direction, limit_a)  # type: ignore[arg-type]
    for name, title, ohm, when in at.resistances():
        made.add(
            name,
            title,
            "mohm",
            "resistance",
            1e3 * ohm,
            f"{when} of 1C, {at.where}; as in the cell file, joints of the battery come on top",
        )
    return made.figures


class _Maker:
    """Multiplies figures of a cell to those of a pack and of the battery."""

    def __init__(self, layout: CellLayout) -> None:
        self.figures: dict[str, Figure] = {}
        self._segment = _factors(layout.n_in_series, layout.n_parallel)
        self._battery = _factors(layout.n_segments * layout.n_in_series, layout.n_parallel)

    def add(
        self, name: str, title: str, unit: str, kind: Kind, value: float | None, condition: str,
        missing: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        segment, battery = (None if value is None else value * of[kind] for of in (self._segment, self._battery))
        self.figures[name] = Figure(name, title, unit, condition, value, segment, battery, missing)


def _factors(n_in_series: int, n_parallel: int) -> Mapping[Kind, float]:
    return {
        "voltage": n_in_series,
        "current": n_parallel,
        "each": n_in_series * n_parallel,
        "resistance": n_in_series / n_parallel,
    }


class _At:
    """A cell at an SOC and a temperature, at rest before."""

    def __init__(self, cell: CellModel, soc: float, temperature_degc: float) -> None:
        self.cell = cell
        self.soc = soc
        self.degc = temperature_degc
        self.where = f"SOC {100.0 * soc:g} %, {temperature_degc:g} degC"
        low, high = cell.measured_degc[0], cell.measured_degc[-1]
        if not low <= temperature_degc <= high:
            self.where += f" (extrapolated: measured at {low:g} to {high:g} degC)"

    def voltage(self, current_a: float, seconds: float, is_settled: bool = False) -> float:
        """Voltage after a constant current from rest; settled: after so long that the drop grows no more."""
        return self._voltage_and_drop(current_a, seconds, is_settled)[0]

    def resistances(self) -> tuple[tuple[str, str, float, str], ...]:
        """Name, title, resistance [ohm] and when."""
        amps = self.cell.c_rate_a

        def ohm(seconds: float, is_settled: bool = False) -> float:
            return self._voltage_and_drop(amps, seconds, is_settled)[1] / amps

        return (
            ("resistance_ohmic_mohm", "resistance, at once", ohm(0.0), "at the first instant"),
            ("resistance_10s_mohm", "resistance, 10 s", ohm(PULSE_S), f"after {PULSE_S:g} s"),
            ("resistance_settled_mohm", "resistance, lasting", ohm(0.0, is_settled=True), "after a long time"),
        )

    def continuous(self, direction: Direction, limit_a: float) -> tuple[float, bool]:
        """Return the largest magnitude of a lasting current [A], and whether the voltage limits it."""
        sign = 1.0 if direction == "discharge" else -1.0

        def holds(amps: float) -> bool:
            volts = self.voltage(sign * amps, 0.0, is_settled=True)
            return volts >= self.cell.v_min_v if sign > 0.0 else volts <= self.cell.v_max_v

        if holds(limit_a):
            return limit_a, False
        low, high = 0.0, limit_a
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if holds(middle) else (low, middle)
        return low, True

    def pulse(self, direction: Direction) -> PowerLimit:
        """Return what can be held for 10 s; the cell file has to say the largest current."""
        power, _ = PowerModel(self.cell, limits_of(self.cell)).predict(self._point(0.0), (), (PULSE_S,))
        return power.discharge[0] if direction == "discharge" else power.charge[0]

    def _point(self, branch_a: float) -> OperatingPoint:
        return OperatingPoint(np.array([self.soc]), np.full((self.cell.n_rc, 1), branch_a), np.array([self.degc]))

    def _voltage_and_drop(self, current_a: float, seconds: float, is_settled: bool) -> tuple[float, float]:
        states = self._point(current_a if is_settled else 0.0)
        amps, time_s = np.array([current_a]), np.array([seconds])
        to = carry_forward(self.cell, states, CellKnowledge(), amps, time_s, math.inf)
        voltage = float(to.voltage_v[0])
        return voltage, float(self.cell.ocv.voltage(to.soc)[0]) - voltage


def _add_direction(made: _Maker, at: _At, direction: Direction, limit_a: float | None) -> None:
    field = f"limits.{direction}_max_a"
    missing = _without(limit_a, field)
    rows: list[tuple[str, str, float | None, float | None, str]]
    if limit_a is None:
        rows = [
            ("continuous", "continuous", None, None, f"{at.where}; the cell file says no largest current"),
            ("10s", "10 s", None, None, f"{at.where}; the cell file says no largest current"),
        ]
    else:
        lasting_a, by_voltage = at.continuous(direction, limit_a)
        sign = 1.0 if direction == "discharge" else -1.0
        lasting_w = lasting_a * at.voltage(sign * lasting_a, 0.0, is_settled=True)
        pulse = at.pulse(direction)
        settled = f"{at.where}, drop settled; limited by {'the voltage' if by_voltage else field}"
        by = {"current": field, "voltage": "the voltage", "soc": "the charge", "temperature": "the temperature"}
        held = f"{at.where}, held throughout from rest; limited by {by[pulse.reason]}"
        rows = [
            ("continuous", "continuous", lasting_a, lasting_w, settled + _beyond(at.cell, lasting_a, math.inf)),
            ("10s", "10 s", pulse.current_a, pulse.power_w, held + _beyond(at.cell, pulse.current_a, PULSE_S)),
        ]
    for name, title, amps, watts, when in rows:
        made.add(f"{direction}_current_{name}_a", f"{direction} current, {title}", "A", "current", amps, when, missing)
        kilowatt = None if watts is None else watts / 1e3
        made.add(f"{direction}_power_{name}_kw", f"{direction} power, {title}", "kW", "each", kilowatt, when, missing)


def _beyond(cell: CellModel, amps: float, seconds: float) -> str:
    if not is_beyond_measured(cell, amps, seconds):
        return ""
    measured_a = float(measured_current_a(cell, seconds))
    return f"; extrapolated: measured up to {measured_a:.3g} A a cell for so long"


def _without(value: float | None, field: str) -> tuple[str, ...]:
    return (field,) if value is None else ()


def _megajoule(watt_hours: float | None) -> float | None:
    return None if watt_hours is None else watt_hours * SECONDS_PER_HOUR / MEGA


def _ocv_wh(cell: CellModel, temperature_degc: float) -> float:
    soc = (np.arange(OCV_POINTS) + 0.5) / OCV_POINTS
    return float(cell.open_circuit_voltage(soc, temperature_degc).mean()) * cell.capacity_ah
