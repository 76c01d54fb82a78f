"""Items: what the links deliver, each with the instant at which it came."""

from dataclasses import dataclass
from typing import Literal

from app.estimation.arrays import FloatArray
from app.telemetry import BusState, LinkName
from app.words import Text
from firmware_protocol.framing import BadFrame, Frame


@dataclass(frozen=True, slots=True)
class SerialItem:
    """A frame, good or bad, with the instant at which its last byte was read."""

    t_mono_ns: int
    t_wall_ns: int
    frame: Frame | BadFrame
    waited_max_ns: int | None = None  # before that, in this computer: at most so long; None = not known
    is_asked: bool = True  # False: a reply that no request waited for; a recorded one counts as asked


@dataclass(frozen=True, slots=True)
class UnframedBytes:
    """Bytes that arrived while no good frame did: how many that are in no `SerialItem`, and the last of all."""

    t_mono_ns: int
    t_wall_ns: int
    count: int
    last: bytes


@dataclass(frozen=True, slots=True)
class SerialBytes:
    """Bytes read at once from a serial line that a profile describes."""

    t_mono_ns: int
    t_wall_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class CanItem:
    """A CAN data frame; bit 31 of the id marks a 29-bit one."""

    t_mono_ns: int
    t_wall_ns: int
    can_id: int
    data: bytes
    sent: bool = False  # by this service


@dataclass(frozen=True, slots=True)
class TableItem:
    """A row of a table: what one instant says of the battery, NaN where it was not measured."""

    t_mono_ns: int
    t_wall_ns: int
    numbers: FloatArray  # current [A], positive on discharge; SOC; voltage of each cell [V]; each sensor [degC]


@dataclass(frozen=True, slots=True)
class LinkChange:
    """A link opened, closed or failed."""

    t_mono_ns: int
    t_wall_ns: int
    link: LinkName
    state: Literal["connecting", "open", "lost"]
    error: Text | None = None
    map_hash: str | None = None  # hash of a recording's memory map


@dataclass(frozen=True, slots=True)
class CanFault:
    """Error state of the CAN adapter's controller, None where it has none; `errors` since the bus was opened."""

    t_mono_ns: int
    t_wall_ns: int
    bus_state: BusState | None
    errors: int | None
    tx_errors: int | None = None  # the controller's error counters, 0..255
    rx_errors: int | None = None


Item = SerialItem | SerialBytes | UnframedBytes | CanItem | CanFault | LinkChange | TableItem
