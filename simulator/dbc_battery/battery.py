"""The simulated battery with a DBC: its shape, sensors, limits, size of its cells, its encoder."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from simulator.accumulator import AccumulatorParameters
from simulator.cell_data import SAMSUNG_25R_10P, CellModel, FloatArray, Table
from simulator.charger_unit import ChargerParameters
from simulator.shape import TEAM, Shape
from simulator.thermal import ThermalParameters

Readings = Mapping[str, FloatArray]  # by kind: `voltage` (n_cells,), `temperature` (n_sensors,), `current` (1,), ...


class BatteryEncoder(Protocol):
    """Turns readings into CAN frames, each message at its rate."""

    @property
    def due_s(self) -> float:
        """Return when the next frame is due [s]."""
        ...

    @property
    def has_fd_frames(self) -> bool:
        """Some frame is longer than classic CAN carries."""
        ...

    def begin(self, now_s: float) -> None:
        """Start anew, as after a boot."""
        ...

    def frames(self, now_s: float, readings: Readings) -> list[tuple[int, bytes]]:
        """Return the frames that are due: id, bit 31 set for a 29-bit one, and data."""
        ...


class SerialVoice(Protocol):
    """Turns readings into bytes on a serial line, by itself or where it is asked."""

    @property
    def due_s(self) -> float:
        """Return when the next bytes are due [s]."""
        ...

    def begin(self, now_s: float) -> None:
        """Start anew, as after a boot."""
        ...

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes that reach the battery."""
        ...

    def bytes_due(self, now_s: float, readings: Readings) -> bytes:
        """Return what is sent now."""
        ...


class SilentBus:
    """The CAN bus of a battery that is on a serial line alone."""

    due_s = float("inf")
    has_fd_frames = False

    def begin(self, now_s: float) -> None:
        """Nothing to start."""

    def frames(self, now_s: float, readings: Readings) -> list[tuple[int, bytes]]:
        """Return none."""
        return []


@dataclass(frozen=True, slots=True)
class TripLimits:
    """Limits at which the BMS trips, sent where its DBC has signals for them."""

    cell_voltage_min_v: float = 2.5
    cell_voltage_max_v: float = 4.2
    temperature_min_degc: float = -15.0
    temperature_max_degc: float = 60.0
    discharge_current_max_a: float = 0.0
    charge_current_max_a: float = 0.0


@dataclass(frozen=True, slots=True)
class DbcBattery:
    """A battery and its voice."""

    shape: Shape
    sensors: tuple[tuple[int, ...], ...]  # cells of each temperature sensor
    capacity_ah: float  # capacity of what is measured as one cell
    limits: Mapping[str, float]  # by a name of `TripLimits`; where none is given, those of the simulated cell
    voice: BatteryEncoder
    serial: SerialVoice | None = None
    bit_rate: int = 500_000  # rate of its bus [bit/s]
    is_alone: bool = False  # nobody else on the bus acknowledges

    @property
    def size(self) -> float:
        """Capacity over that of the simulated cell, ten cans."""
        return self.capacity_ah / SAMSUNG_25R_10P.capacity_ah

    @property
    def share_of_team(self) -> float:
        """Number of cells over that of the team's own battery, for which cars and chargers are made."""
        return self.shape.n_cells / TEAM.n_cells

    def trip_limits(self) -> TripLimits:
        """Return the limits in force; currents are 8 C and 4 C where none are given."""
        defaults = {
            "discharge_current_max_a": 8.0 * self.capacity_ah,
            "charge_current_max_a": 4.0 * self.capacity_ah,
        }
        limits = {name: value for name, value in self.limits.items() if name in TripLimits.__dataclass_fields__}
        return TripLimits(**{**defaults, **limits})

    def charger(self) -> ChargerParameters:
        """Return a charger of the right size."""
        usual = ChargerParameters()
        share, size = self.share_of_team, self.size
        return replace(
            usual,
            max_power_w=usual.max_power_w * share * size,
            max_voltage_v=usual.max_voltage_v * share,
            max_current_a=usual.max_current_a * size,
            min_battery_v=usual.min_battery_v * share,
            ramp_up_a_per_s=usual.ramp_up_a_per_s * size,
            ramp_down_a_per_s=usual.ramp_down_a_per_s * size,
            loop_ohm=usual.loop_ohm * share / size,
            cooling_w_per_k=usual.cooling_w_per_k * share * size,
        )

    def built_as(self, parameters: AccumulatorParameters) -> AccumulatorParameters:
        """Return a scenario's accumulator in this battery's shape and size."""
        size, usual = self.size, ThermalParameters()
        thermal = replace(
            usual,
            along_row_w_per_k=usual.along_row_w_per_k * size,
            across_rows_w_per_k=usual.across_rows_w_per_k * size,
            natural_w_per_k=usual.natural_w_per_k * size,
            forced_w_per_k=usual.forced_w_per_k * size,
            duct_flow_w_per_k=usual.duct_flow_w_per_k * size,
        )
        return replace(
            parameters,
            n_cells=self.shape.n_cells,
            packs=self.shape.packs,
            cell=scaled(SAMSUNG_25R_10P, size),
            joint_resistance_ohm=parameters.joint_resistance_ohm / size,
            path_resistance_ohm=parameters.path_resistance_ohm * self.share_of_team / size,
            thermal=thermal,
        )


def scaled(model: CellModel, size: float) -> CellModel:
    """Return a cell of the same kind with `size` times as many cans in parallel."""

    def smaller(ohm: Table) -> Table:
        return Table(ohm.soc, tuple(value / size for value in ohm.value))

    return replace(
        model,
        capacity_ah=model.capacity_ah * size,
        ohmic_ohm=smaller(model.ohmic_ohm),
        charge_transfer_ohm=smaller(model.charge_transfer_ohm),
        rc_ohm=tuple(map(smaller, model.rc_ohm)),
        rc_f=tuple(pair * size for pair in model.rc_f),
        self_discharge_a=model.self_discharge_a * size,
        heat_capacity_j_per_k=model.heat_capacity_j_per_k * size,
    )
