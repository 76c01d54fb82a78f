"""A snapshot: all that is known of the battery at one instant, in SI units. Frozen all the way down, no behaviour.

None and NaN are missing values. Current is positive on discharge. Unit, meaning and decimals of a field stand here and
nowhere else; JSON, OpenAPI, the page's types, history, MQTT and the replay test's keys are derived (see `fields`).
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.prediction.energy import LapsLeft
from app.estimation.prediction.energy_target import EnergyTarget
from app.estimation.prediction.power import StatePower, TimeToTrip
from app.telemetry.cell_findings import Finding
from app.telemetry.events import Alarm, Disagreement, Links
from app.telemetry.fields import INTERNAL, LEFT_OUT, TREND, Kept, SentAs, Unit
from app.telemetry.last_known import LastKnown
from app.words import Message, Text

Source = Literal["simulator", "serial", "can", "replay"]
MasterState = Literal["unknown", "idle", "drive", "charge", "balance", "fault"]
ChargerState = Literal["off", "waiting", "constant_current", "balancing", "constant_voltage", "done", "fault"]
Number = float | None


@dataclass(frozen=True, slots=True)
class Ages:
    """Seconds since the master measured the oldest byte of each part; null: never received."""

    current: Annotated[Number, Unit("s", "accumulator current")]
    voltage: Annotated[Number, Unit("s", "cell voltages")]
    temperature: Annotated[Number, Unit("s", "cell temperatures")]
    status: Annotated[Number, Unit("s", "status flags")]
    charger: Annotated[Number, Unit("s", "charger")]
    soc: Annotated[Number, Unit("s", "the master's own SOC")]
    slaves: Annotated[Number, Unit("s", "slave boards")]
    config: Annotated[Number, Unit("s", "configuration")]


@dataclass(frozen=True, slots=True)
class Cells:
    """Arrays of one value a cell, in the order of the packs; missing values are NaN, null in JSON."""

    voltage_v: Annotated[FloatArray, Unit("V", "cell voltage", 4), Kept("voltage")]
    temperature_degc: Annotated[FloatArray, Unit("degC", "cell temperature", 1), Kept("temperature")]
    soc: Annotated[FloatArray, Unit("1", "state of charge of each cell, 0 to 1", 5), Kept("voltage")]
    soc_sigma: Annotated[FloatArray, Unit("1", "its standard deviation", 5), Kept("voltage")]
    ocv_v: Annotated[FloatArray, Unit("V", "open-circuit voltage", 4)]
    residual_v: Annotated[FloatArray, Unit("V", "measured minus predicted voltage", 4), Kept("voltage")]
    resistance_ohm: Annotated[FloatArray, Unit("ohm", "resistance of cell and joint", 6), TREND]
    capacity_ah: Annotated[FloatArray, Unit("Ah", "capacity in use: the cell file's until learned", 3)]
    soh_capacity: Annotated[FloatArray, Unit("1", "capacity against new; missing until learned", 4)]
    resistance_factor: Annotated[FloatArray, Unit("1", "resistance against the cell file; missing until learned", 3)]
    joint_excess_ohm: Annotated[FloatArray, Unit("ohm", "growth of the busbar joint against its peers", 6), TREND]
    balancing: Annotated[BoolArray | None, TREND]
    model_valid: BoolArray | None
    joint_loose: BoolArray | None
    voltage_age_s: Annotated[FloatArray | None, LEFT_OUT, Unit("s", "since each voltage came", 1)] = None


@dataclass(frozen=True, slots=True)
class Pack:
    """Cells that are measured by one board."""

    voltage_v: Annotated[Number, Unit("V", "sum of the cells, missing where one is missing")]
    min_v: Annotated[Number, Unit("V", "lowest cell voltage")]
    max_v: Annotated[Number, Unit("V", "highest cell voltage")]
    delta_v: Annotated[Number, Unit("V", "highest minus lowest cell voltage, missing where one is missing")]
    temperature_max_degc: Annotated[Number, Unit("degC", "hottest cell")]
    temperature_min_degc: Annotated[Number, Unit("degC", "coldest cell")]
    slave_status: int | None


@dataclass(frozen=True, slots=True)
class LowestUnderLoad:
    """The lowest cell voltage of the last drive while current was drawn."""

    voltage_v: Annotated[float, Unit("V", "cell voltage")]
    cell: int
    current_a: Annotated[float, Unit("A", "current at that instant")]
    t_wall_ns: Annotated[int, SentAs("time", 1e9)]


@dataclass(frozen=True, slots=True)
class Accumulator:
    """All cells."""

    voltage_v: Annotated[Number, Unit("V", "voltage of all cells, missing where one is missing"), Kept("voltage")]
    current_a: Annotated[Number, Unit("A", "current, positive on discharge"), Kept("current")]
    power_w: Annotated[Number, Unit("W", "power, positive on discharge"), Kept("current")]
    soc: Annotated[Number, Unit("1", "state of charge, 0 to 1"), Kept("voltage")]
    soc_source: Literal["filter", "master"] | None
    soc_sigma: Annotated[Number, Unit("1", "standard deviation of the state of charge"), Kept("voltage")]
    driver_soc_percent: Annotated[int | None, Unit("%", "state of charge as the driver sees it"), Kept("voltage")]
    soc_min: Annotated[Number, Unit("1", "state of charge of the emptiest cell"), Kept("voltage")]
    soc_min_cell: int | None
    soc_max: Annotated[Number, Unit("1", "state of charge of the fullest cell"), Kept("voltage")]
    soc_max_cell: int | None
    soc_spread: Annotated[Number, Unit("1", "fullest minus emptiest cell")]
    voltage_min_v: Annotated[Number, Unit("V", "lowest cell voltage"), Kept("voltage")]
    voltage_min_cell: int | None
    voltage_max_v: Annotated[Number, Unit("V", "highest cell voltage"), Kept("voltage")]
    voltage_max_cell: int | None
    voltage_mean_v: Annotated[Number, Unit("V", "mean of all cell voltages, missing where one is missing")]
    voltage_delta_v: Annotated[
        Number, Unit("V", "highest minus lowest of all cell voltages, missing where one is missing"), Kept("voltage")
    ]
    temperature_min_degc: Annotated[Number, Unit("degC", "coldest cell"), Kept("temperature")]
    temperature_min_cell: int | None
    temperature_max_degc: Annotated[Number, Unit("degC", "hottest cell"), Kept("temperature")]
    temperature_max_cell: int | None
    temperature_mean_degc: Annotated[Number, Unit("degC", "mean cell temperature")]
    loaded_cells: Annotated[int, Unit("1", "cells with a voltage")]
    energy_out_wh: Annotated[float, Unit("Wh", "energy that flowed out")]
    energy_in_wh: Annotated[float, Unit("Wh", "energy that flowed in")]
    fan_duty: Annotated[Number, Unit("1", "fans, 0 to 1")]
    voltage_at_least_v: Annotated[Number, LEFT_OUT, Unit("V", "sum of the measured cells, where one is missing")] = None
    energy_gap_s: Annotated[
        Number, LEFT_OUT, Unit("s", "under load with a cell missing: the energies are at least these")
    ] = None
    lowest_under_load: LowestUnderLoad | None = None


@dataclass(frozen=True, slots=True)
class CountedWith:
    """Number of cells that use a learned capacity and resistance; the factors are against the cell file."""

    capacity_cells: int
    capacity_factor: Annotated[Number, Unit("1", "mean learned capacity", None)]
    resistance_cells: int
    resistance_factor: Annotated[Number, Unit("1", "mean learned resistance", None)]


@dataclass(frozen=True, slots=True)
class Prediction:
    """The prediction, computed once a second."""

    power: StatePower | None
    to_trip: tuple[TimeToTrip, ...]  # at the present current; infinite seconds are sent as null
    to_trip_full: tuple[TimeToTrip, ...]  # at the full discharge current
    nearest: TimeToTrip | None
    energy_left_wh: Annotated[Number, Unit("Wh", "energy until the first cell is empty", None)]
    energy_left_sigma_wh: Annotated[Number, Unit("Wh", "its standard deviation", None)]
    energy_left_low_wh: Annotated[Number, Unit("Wh", "lower end of its band", None)]
    energy_left_high_wh: Annotated[Number, Unit("Wh", "upper end of its band", None)]
    energy_left_cell: int | None
    energy_left_beyond_measured: bool | None  # such a load was never measured for so long, or at such a temperature
    counted_with: CountedWith | None
    laps: LapsLeft | None
    target: EnergyTarget | None  # energy of a lap; None without a plan
    coverage: Annotated[float, Unit("1", "share of cases in which the truth is expected within a band", None)]
    age_s: Annotated[Number, Unit("s", "since all of this was judged", 3)]
    load_a: Annotated[Number, Unit("A", "mean current of the last seconds, which `to_trip` counts with", 3)]
    measured_current_max_a: Annotated[Number, Unit("A", "largest current the cell file was measured with", None)]
    power_condition: Message  # under which each of them holds, or why there is none
    to_trip_condition: Message
    energy_condition: Message
    laps_condition: Message


@dataclass(frozen=True, slots=True)
class Flags:
    """The master's status bits."""

    fit: bool
    usb: bool
    i2c1: bool
    usart1: bool
    can1: bool
    charger: bool
    charging: bool
    balancing: bool
    load: bool | None  # None: CAN alone carried the first eight


@dataclass(frozen=True, slots=True)
class Master:
    """State that the master reports."""

    state: MasterState
    why: Message
    fit: bool | None
    flags: Flags | None
    soc: Annotated[Number, Unit("1", "the master's own count", None)]
    charge_drawn_ah: Annotated[Number, Unit("Ah", "charge drawn, by the master's count", None)]
    n_slaves: int | None
    can_tx_enabled: int | None
    can_rx_enabled: int | None
    can_rx_active: int | None
    firmware: str | None
    protocol: int | None
    map_hash: str | None
    map_matches: bool | None
    boots: int | None
    restarted: Text | None  # why, within a minute of a restart; else None
    implausible: tuple[str, ...]  # fields of the memory map whose values cannot be, and are left out


@dataclass(frozen=True, slots=True)
class Charger:
    """The charger as the master sees it."""

    state: ChargerState | None
    asked_voltage_v: Annotated[Number, Unit("V", "voltage that the master asks for")]
    asked_current_a: Annotated[Number, Unit("A", "current that the master asks for")]
    voltage_v: Annotated[Number, Unit("V", "output voltage")]
    current_a: Annotated[Number, Unit("A", "output current")]
    enabled: bool | None
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Estimator:
    """The filter."""

    filter: str
    cell: str
    step_us: Annotated[Number, Unit("us", "duration of one step")]
    started: bool
    skipped: int
    current_offset_a: Annotated[Number, Unit("A", "offset of the current sensor, where observable")]
    current_offset_sigma_a: Annotated[Number, Unit("A", "its standard deviation")]
    resistance_age_s: Annotated[Number, Unit("s", "since current last showed the resistances", 1)] = None


@dataclass(frozen=True, slots=True)
class Check:
    """Two numbers that ought to agree: whether they do (null: not known), the value judged, its limit."""

    verdict: bool | None
    value: Annotated[Number, Unit("", "in `unit`")]
    limit: Annotated[float, Unit("", "in `unit`")]
    unit: str
    cell: int | None


@dataclass(frozen=True, slots=True)
class Plausibility:
    """Sum of the cells against the total, resistance by current and voltage, chips against the master."""

    sum: Check
    current: Check
    chips: Check


@dataclass(frozen=True, slots=True)
class ProtectionLimits:
    """Limits at which the shutdown circuit opens, by the master's configuration or the profile; NaN: unknown."""

    cell_voltage_min_v: float
    cell_voltage_max_v: float
    temperature_min_degc: float
    temperature_max_degc: float
    discharge_max_a: float  # while driving
    discharge_min_a: float  # while driving: negative, what is recuperated
    charger_max_a: float  # positive, as set for the charger
    charger_min_a: float
    accumulator_voltage_max_v: float = math.nan
    pack_voltage_max_v: float = math.nan
    in_any_state: bool = False  # they hold whether the state is known or not


@dataclass(frozen=True, slots=True)
class Snapshot:
    """All that is known at one instant."""

    sequence: Annotated[int, SentAs("seq")]
    t_mono_ns: Annotated[int, INTERNAL]
    t_wall_ns: Annotated[int, SentAs("time", 1e9)]
    uptime_s: Annotated[Number, Unit("s", "the master's clock", None)]
    source: Source
    age_s: Annotated[Ages, SentAs("age")]
    cells: Cells
    packs: tuple[Pack, ...]
    accumulator: Accumulator
    prediction: Prediction | None  # None without an estimator
    master: Master
    charger: Charger
    links: Links
    estimator: Estimator
    plausibility: Plausibility
    alarms: tuple[Alarm, ...] = ()
    findings: tuple[Finding, ...] = ()  # findings of single cells, the surest first; kept until evidence ends them
    last_known: LastKnown | None = None  # last values of what is missing above; None where nothing ever was measured
    config_hash: str | None = None
    limits: Annotated[ProtectionLimits | None, INTERNAL] = None
    config: Annotated[bytes | None, INTERNAL] = None  # in force, as last received as a whole
    disagreements: Annotated[tuple[Disagreement, ...], INTERNAL] = ()  # between RS232 and CAN
    is_fresh: Annotated[bool, INTERNAL] = True  # made from new bytes, not only aged
    live_s: Annotated[Ages | None, LEFT_OUT] = None  # as long as a part counts as live, where that is not one second
    awaited: Annotated[BoolArray | None, INTERNAL] = None  # cells of the first round that may still come
    segments: Annotated[tuple[int, ...], INTERNAL] = ()  # cells of each, in the order of the packs
