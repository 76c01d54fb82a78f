"""What flows through the service: items from the links, snapshots to the readers. Frozen, SI units, no behaviour."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.framing import BadFrame, Frame

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
LinkName = Literal["rs232", "can"]
LinkState = Literal["off", "connecting", "silent", "live", "lost"]
BusState = Literal["active", "warning", "passive", "off"]
Severity = Literal["info", "watch", "warning", "trip"]
Source = Literal["simulator", "serial", "can", "replay"]
MasterState = Literal["unknown", "idle", "drive", "charge", "balance", "fault"]


@dataclass(frozen=True, slots=True)
class SerialItem:
    """A frame, good or bad, with the instant at which its last byte was read."""

    t_mono_ns: int
    t_wall_ns: int
    frame: Frame | BadFrame


@dataclass(frozen=True, slots=True)
class CanItem:
    """A CAN data frame; bit 31 of the id marks a 29-bit one."""

    t_mono_ns: int
    t_wall_ns: int
    can_id: int
    data: bytes
    sent: bool = False  # by this service


@dataclass(frozen=True, slots=True)
class LinkChange:
    """A link opened, closed or failed."""

    t_mono_ns: int
    t_wall_ns: int
    link: LinkName
    state: Literal["connecting", "open", "lost"]
    error: str | None = None


@dataclass(frozen=True, slots=True)
class CanFault:
    """What the CAN adapter's controller says, None where it does not; `errors` since the bus was opened."""

    t_mono_ns: int
    t_wall_ns: int
    bus_state: BusState | None
    errors: int | None
    tx_errors: int | None = None  # the controller's error counters, 0..255
    rx_errors: int | None = None


Item = SerialItem | CanItem | CanFault | LinkChange


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """How far a link can be trusted."""

    state: LinkState = "off"
    url: str | None = None
    age_s: float | None = None  # since the last good frame
    frames: int = 0
    lost: int = 0  # by gaps in the sequence
    crc_errors: int = 0
    resyncs: int = 0  # chunks that were no frame for another reason
    bytes: int = 0
    rate_hz: float = 0.0  # snapshots (rs232) or frames (can) in the last second
    bytes_per_s: float = 0.0
    line_load: float | None = None  # share of the line's capacity; of CAN's, with the most bits that stuffing can add
    reconnects: int = 0
    error: str | None = None
    errors: int | None = None  # error frames of a CAN adapter, None where it passes none on
    tx_errors: int | None = None  # its controller's error counters
    rx_errors: int | None = None
    bus_state: BusState | None = None  # None while it said nothing


@dataclass(frozen=True, slots=True)
class Disagreement:
    """One value of which the links say two things, in its unit."""

    name: str
    rs232: float
    can: float
    unit: str
    since_ns: int


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened; `id` is given by the log."""

    time_ns: int
    severity: Severity
    code: str
    text: str
    cell: int | None = None
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    who: str | None = None


@dataclass(frozen=True, slots=True)
class Alarm:
    """A condition that holds, or held and was not acknowledged."""

    id: int
    code: str
    severity: Severity
    text: str
    since_ns: int
    active: bool
    cell: int | None = None
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    acknowledged_by: str | None = None


@dataclass(frozen=True, slots=True)
class Cells:
    """Arrays of 96; NaN where missing."""

    voltage_v: FloatArray
    temperature_degc: FloatArray
    soc: FloatArray
    soc_sigma: FloatArray
    ocv_v: FloatArray
    residual_v: FloatArray  # measured minus predicted
    resistance_ohm: FloatArray
    capacity_ah: FloatArray  # counted with: the cell file's until learned
    balancing: BoolArray | None
    model_valid: BoolArray | None
    soh_capacity: FloatArray  # against new; NaN until learned
    resistance_factor: FloatArray  # against the cell file at the same charge and temperature; NaN until learned
    joint_excess_ohm: FloatArray  # of the busbar joint, against its own past and its peers
    joint_loose: BoolArray | None


@dataclass(frozen=True, slots=True)
class Identity:
    """What the master said of itself."""

    firmware: str
    protocol: int
    map_hash: str
    is_compatible: bool
    boots: int


@dataclass(frozen=True, slots=True)
class Snapshot:
    """All that is known at one instant. Never changed after it was made."""

    sequence: int
    t_mono_ns: int
    t_wall_ns: int
    uptime_s: float | None
    source: Source
    image: bytes  # the shadow, 2984 bytes
    age_s: dict[str, float | None]
    cells: Cells
    accumulator: dict[str, Any]
    packs: list[dict[str, Any]]
    prediction: dict[str, Any] | None  # what lies ahead; None without an estimator
    master: dict[str, Any]
    charger: dict[str, Any]
    links: dict[LinkName, LinkStatus]
    estimator: dict[str, Any]
    alarms: tuple[Alarm, ...] = ()
    replay: dict[str, Any] | None = None
    config: bytes | None = None  # in force, as last heard as a whole
    config_hash: str | None = None
    disagreements: tuple[Disagreement, ...] = ()  # between RS232 and CAN
    plausibility: dict[str, dict[str, Any]] = field(default_factory=dict)  # by check: verdict, value, limit, unit, cell
    is_fresh: bool = True  # made from new bytes, not only aged
