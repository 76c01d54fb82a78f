"""Looking back: laps, black boxes, reports, comparisons."""

from typing import Literal

from pydantic import BaseModel

from app.api.schemas.snapshot import Number, PerCell, Severity

LapSource = Literal["settled", "markers", "pattern", "can", "signal"]


class LapOut(BaseModel):
    """A stretch that counts as a lap; times in unix seconds."""

    start_s: float
    end_s: float
    driver: str
    note: str
    counts: bool


class LapFiguresOut(BaseModel):
    """One lap and what it cost."""

    lap: LapOut
    energy_out_wh: float
    energy_in_wh: float
    power_mean_w: Number
    power_max_w: Number
    power_min_w: Number
    current_rms_a: Number
    soc_used: Number
    temperature_rise_k: Number
    temperature_max_degc: Number
    temperature_max_cell: int | None
    voltage_min_v: Number
    weakest_cell: int | None


class DriverFiguresOut(BaseModel):
    """Means over a driver's laps that count."""

    driver: str
    laps: int
    lap_s: float
    best_lap_s: float
    lap_spread_s: float
    energy_out_wh: float
    energy_in_wh: float
    regenerated_share: Number
    power_mean_w: Number
    power_max_w: Number
    soc_used: Number
    temperature_rise_k: Number


class LapTableOut(BaseModel):
    """Laps of a session and where they come from; drivers, the quickest first."""

    source: LapSource
    laps: list[LapFiguresOut]
    drivers: list[DriverFiguresOut]


class LapTraceOut(BaseModel):
    """One signal over equal parts of a lap."""

    lap: int
    minimum: list[Number]
    maximum: list[Number]


class LapOverlayOut(BaseModel):
    """Laps on each other: part k of every lap begins at k / points of its time."""

    signal: str
    unit: str
    points: int
    laps: list[LapTraceOut]


class BoxItemOut(BaseModel):
    """A black box in a list; `time` in unix seconds."""

    id: str
    time: float
    session_id: str | None
    code: str
    severity: Severity
    cell: int | None
    text: str
    is_complete: bool


class BoxItemsOut(BaseModel):
    """Newest first."""

    boxes: list[BoxItemOut]


class BoxEventOut(BaseModel):
    """What was reported; `t_s` from the trip."""

    t_s: float
    severity: Severity
    code: str
    text: str


class BoxBeyondOut(BaseModel):
    """How long the value was beyond its limit; `since_s` null: never seen beyond it."""

    since_s: Number
    lasted_s: Number
    ended: bool | None
    worst: float


class BoxPeersOut(BaseModel):
    """The other cells at the trip."""

    low: float
    mean: float
    high: float
    apart: float
    also_beyond: int


class BoxCellsOut(BaseModel):
    """Every cell before, at and during it."""

    voltage_before_v: PerCell
    voltage_at_v: PerCell
    voltage_min_v: PerCell
    voltage_max_v: PerCell
    temperature_at_degc: PerCell
    soc_at: PerCell
    current_at_trip_a: Number
    opened_s: Number


class BoxSamplesOut(BaseModel):
    """Everything at full rate; tables are cell by cell."""

    time_s: list[Number]
    current_a: list[Number]
    voltage_v: list[list[Number]]
    temperature_degc: list[list[Number]]
    soc: list[list[Number]]
    fit: list[Number]
    load: list[Number]


class BlackBoxOut(BaseModel):
    """What happened around a trip; times in seconds from it, `at` in unix seconds."""

    id: str
    session_id: str | None
    at: float
    code: str
    severity: Severity
    text: str
    cell: int | None
    value: Number
    limit: Number
    unit: str
    quantity: Literal["voltage", "temperature", "current"] | None
    side: Literal["low", "high"] | None
    config_hash: str | None
    limits: dict[str, float]
    events: list[BoxEventOut]
    is_complete: bool
    rate_hz: Number
    beyond: BoxBeyondOut | None
    peers: BoxPeersOut | None
    cells: BoxCellsOut
    samples: BoxSamplesOut
    summary: list[str]


class HistogramOut(BaseModel):
    """Seconds in each bin, of temperature and SOC times cells; edges are one more than bins."""

    unit: str
    edges: list[float]
    seconds: list[float]
    below_s: float
    above_s: float


class MarginOut(BaseModel):
    """How near a session came to a limit; a negative margin is beyond it."""

    limit: str
    name: str
    unit: str
    seen: float
    allowed: float
    margin: float
    cell: int | None
    at_s: Number


class OddCellOut(BaseModel):
    """A cell that is unlike the others."""

    cell: int
    what: str
    value: float
    usual: float
    unit: str
    text: str


class SessionReportOut(BaseModel):
    """How a session went; `why`: which cell failed, and why, empty where none did; what limited, what to look at."""

    headline: str
    why: list[str]
    limited: list[str]
    look_at: list[str]
    margins: list[MarginOut]
    odd: list[OddCellOut]
    figures: dict[str, Number]
    histograms: dict[str, HistogramOut]
    resistance_ohm: PerCell
    voltage_min_v: PerCell
    temperature_max_degc: PerCell
    balancing_s: PerCell


class CellChangeOut(BaseModel):
    """A cell whose resistance changed against the others' change."""

    cell: int
    change: float
    resistance_a_ohm: float
    resistance_b_ohm: float


class SessionComparedOut(BaseModel):
    """One of two sessions."""

    id: str
    name: str
    started: float
    figures: dict[str, Number]
    histograms: dict[str, HistogramOut]


class SessionComparisonOut(BaseModel):
    """Two sessions side by side; cells that changed the most first."""

    a: SessionComparedOut
    b: SessionComparedOut
    cells: list[CellChangeOut]


class DriftOut(BaseModel):
    """A cell that moves away from the others; `weeks` until its limit, 0: it is passed."""

    cell: int
    what: Literal["capacity", "resistance", "self-discharge"]
    per_week: float
    now: float
    limit: float
    weeks: float
    text: str


class SwapOut(BaseModel):
    """Modules that were replaced; `time_s` in unix seconds."""

    id: int
    time_s: float
    cells: list[int]
    note: str
    who: str | None


class PassportsOut(BaseModel):
    """Every cell as it is now, out of all sessions read; `reading` of `to_read` while more are read."""

    sessions: int
    reading: int
    to_read: int
    capacity_ah: PerCell
    capacity_sigma_ah: PerCell
    resistance_ohm: PerCell
    resistance_relative: PerCell
    self_discharge_per_day: PerCell
    balancing_h: PerCell
    rank: PerCell
    drifts: list[DriftOut]
    swaps: list[SwapOut]


class PassportEntryOut(BaseModel):
    """What one session told about a cell; `line` counts its modules from 0."""

    session_id: str
    time_s: float
    line: int
    capacity_ah: Number
    capacity_sigma_ah: Number
    resistance_ohm: Number
    resistance_relative: Number
    self_discharge_per_day: Number
    balancing_h: Number


class CellPassportOut(BaseModel):
    """The life of one cell's place, the oldest session first."""

    cell: int
    rank: Number
    entries: list[PassportEntryOut]
    drifts: list[DriftOut]
    swaps: list[SwapOut]
