"""The snapshot's shape for OpenAPI and for the front end's generated types. null = missing, never 0."""

from typing import Literal

from pydantic import BaseModel

Number = float | None
PerCell = list[float | None]
Severity = Literal["info", "watch", "warning", "trip"]
AlarmSeverity = Literal["watch", "warning", "trip"]


class CellsOut(BaseModel):
    """Arrays of 96, index = pack * 12 + position."""

    voltage_v: PerCell
    temperature_degc: PerCell
    soc: PerCell
    soc_sigma: PerCell
    ocv_v: PerCell
    residual_v: PerCell
    resistance_ohm: PerCell
    capacity_ah: PerCell
    soh_capacity: PerCell
    resistance_factor: PerCell
    joint_excess_ohm: PerCell
    balancing: list[bool | None]
    model_valid: list[bool | None]
    joint_loose: list[bool | None]


class PackOut(BaseModel):
    """Twelve cells and their slave."""

    voltage_v: Number
    min_v: Number
    max_v: Number
    delta_v: Number
    temperature_max_degc: Number
    temperature_min_degc: Number
    slave_status: int | None


class AccumulatorOut(BaseModel):
    """All 96 cells."""

    voltage_v: Number
    current_a: Number
    power_w: Number
    soc: Number
    soc_source: Literal["filter", "master"] | None
    soc_sigma: Number
    driver_soc_percent: int | None
    soc_min: Number
    soc_min_cell: int | None
    soc_max: Number
    soc_max_cell: int | None
    soc_spread: Number
    voltage_min_v: Number
    voltage_min_cell: int | None
    voltage_max_v: Number
    voltage_max_cell: int | None
    voltage_mean_v: Number
    voltage_delta_v: Number
    temperature_min_degc: Number
    temperature_min_cell: int | None
    temperature_max_degc: Number
    temperature_max_cell: int | None
    temperature_mean_degc: Number
    loaded_cells: int
    energy_out_wh: float
    energy_in_wh: float
    fan_duty: Number


class PowerLimitOut(BaseModel):
    """What can be held for one horizon, and what limits it."""

    horizon_s: float
    power_w: float
    current_a: float
    cell: int | None
    reason: Literal["voltage", "soc", "temperature", "current"]


class PowerOut(BaseModel):
    """Power ahead in both directions, shortest horizon first."""

    discharge: list[PowerLimitOut]
    charge: list[PowerLimitOut]


class TripOut(BaseModel):
    """Seconds until a limit is met; null: not within an hour."""

    limit: Literal["v_min", "v_max", "soc_min", "soc_max", "temperature_max"]
    seconds: Number
    cell: int | None


class LapsOut(BaseModel):
    """Laps that the energy lasts for, with a band from 5 to 95 %."""

    laps: float
    low: float
    high: float
    lap_energy_wh: float
    lap_energy_sigma_wh: float
    period_s: Number


class CountedWithOut(BaseModel):
    """How many cells are counted with a learned capacity and resistance; the factors are against the cell file."""

    capacity_cells: int
    capacity_factor: Number
    resistance_cells: int
    resistance_factor: Number


class PredictionOut(BaseModel):
    """What lies ahead, judged once a second."""

    power: PowerOut | None
    to_trip: list[TripOut]
    to_trip_full: list[TripOut]
    nearest: TripOut | None
    energy_left_wh: Number
    energy_left_sigma_wh: Number
    energy_left_cell: int | None
    counted_with: CountedWithOut | None
    laps: LapsOut | None


class FlagsOut(BaseModel):
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


class MasterOut(BaseModel):
    """What the master says of itself."""

    state: Literal["unknown", "idle", "drive", "charge", "balance", "fault"]
    why: str
    fit: bool | None
    flags: FlagsOut | None
    soc: Number
    charge_drawn_ah: Number
    n_slaves: int | None
    can_tx_enabled: int | None
    can_rx_enabled: int | None
    can_rx_active: int | None
    firmware: str | None
    protocol: int | None
    map_hash: str | None
    map_matches: bool | None
    boots: int | None


class ChargerOut(BaseModel):
    """The charger as the master sees it."""

    state: Literal["off", "waiting", "constant_current", "balancing", "constant_voltage", "done", "fault"] | None
    asked_voltage_v: Number
    asked_current_a: Number
    voltage_v: Number
    current_a: Number
    enabled: bool | None
    flags: list[str]


class LinkOut(BaseModel):
    """One link's trust."""

    state: Literal["off", "connecting", "silent", "live", "lost"]
    url: str | None
    age_s: Number
    frames: int
    lost: int
    crc_errors: int | None  # None: CAN's controller does not tell
    resyncs: int | None
    bytes: int
    rate_hz: float
    bytes_per_s: float
    line_load: Number
    reconnects: int
    error: str | None
    errors: int | None  # error frames of a CAN adapter; null where it passes none on
    tx_errors: int | None
    rx_errors: int | None
    bus_state: Literal["active", "warning", "passive", "off"] | None


class LinksOut(BaseModel):
    """Both links."""

    rs232: LinkOut
    can: LinkOut


class EstimatorOut(BaseModel):
    """The filter."""

    filter: str
    cell: str
    step_us: Number
    started: bool
    skipped: int
    current_offset_a: Number
    current_offset_sigma_a: Number


class AlarmOut(BaseModel):
    """A condition that holds, or held and was not acknowledged."""

    id: int
    code: str
    severity: AlarmSeverity
    text: str
    since: float
    active: bool
    cell: int | None
    value: Number
    limit: Number
    unit: str
    acknowledged_by: str | None


class RecordingOut(BaseModel):
    """The session being recorded."""

    session_id: str
    since: float
    frames: int
    bytes: int


class ReplayComparedOut(BaseModel):
    """State of charge as recorded and as recomputed, at the newest sample."""

    recorded_soc: Number
    recorded_soc_min: Number
    recomputed_soc: Number
    recomputed_soc_min: Number
    largest_difference: Number
    largest_difference_cell: int | None


class ReplayOut(BaseModel):
    """Where a replay stands, and with what it recomputes the estimates."""

    session_id: str
    position_s: float
    duration_s: float
    speed: float
    paused: bool
    finished: bool
    loop: tuple[float, float] | None
    filter: str
    cell: str
    estimates: Literal["recomputed", "recorded"]
    compared: ReplayComparedOut | None


class AgeOut(BaseModel):
    """Seconds since the oldest byte of each part arrived; null: never."""

    current: Number
    voltage: Number
    temperature: Number
    status: Number
    soc: Number
    charger: Number
    slaves: Number
    config: Number


class CheckOut(BaseModel):
    """Two numbers that ought to agree: whether they do (null: not known), the value judged, its limit."""

    verdict: bool | None
    value: Number
    limit: float
    unit: str
    cell: int | None


class PlausibilityOut(BaseModel):
    """Sum of the cells against the total, resistance by current and voltage, chips against the master."""

    sum: CheckOut
    current: CheckOut
    chips: CheckOut


class SnapshotOut(BaseModel):
    """All that is known at one instant."""

    seq: int
    time: float
    uptime_s: Number
    source: Literal["simulator", "serial", "can", "replay"]
    age: AgeOut
    cells: CellsOut
    packs: list[PackOut]
    accumulator: AccumulatorOut
    prediction: PredictionOut | None
    master: MasterOut
    charger: ChargerOut
    links: LinksOut
    estimator: EstimatorOut
    plausibility: PlausibilityOut
    recording: RecordingOut | None
    replay: ReplayOut | None
    alarms: list[AlarmOut]
    last_event_id: int
    config_hash: str | None
    config_stored_hash: str | None
