"""Facts of a session and of the recorder."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from app.words import Message

UNDATED = "undated"  # key of the metadata: the start is a guess by the time of an imported file


@dataclass(frozen=True, slots=True)
class SessionInfo:
    """One session; wall times in nanoseconds since 1970 UTC, monotonic ones of the machine that recorded it."""

    id: str
    path: Path
    name: str
    started_wall_ns: int
    started_mono_ns: int
    ended_wall_ns: int | None = None  # end; time of the last frame if unclosed
    ended_mono_ns: int | None = None
    is_closed: bool = False  # False while it is recorded, and for ever where recording was cut off
    frames: int = 0
    can_frames: int = 0
    events: int = 0
    markers: int = 0
    size_bytes: int = 0
    voltwall: str = ""  # version that recorded it
    map_hash: str = ""
    metadata: Mapping[str, object] = field(default_factory=dict)

    @property
    def duration_s(self) -> float:
        """Return the time from the start to the end, or to the last frame [s]."""
        return max(0, (self.ended_mono_ns or self.started_mono_ns) - self.started_mono_ns) / 1e9


class RecorderState(StrEnum):
    """State of the recorder."""

    IDLE = "idle"
    RECORDING = "recording"
    STALLED = "stalled"  # the disk does not take it: kept in memory, tried again


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """The recorder at one instant."""

    state: RecorderState
    session: SessionInfo | None
    queued_items: int  # received, not on the disk yet
    queued_bytes: int
    lost_items: int  # items lost in this session: the disk stayed full until the queue was full as well
    disk_free_bytes: int | None
    warning: Message | None  # the disk will be full soon
    error: Message | None  # why it is stalled
    commit_delay_s: float | None = None  # from a frame's arrival to its commit, the longest of the last minute
    stalled_ns: int | None = None  # since when nothing gets onto the disk, since 1970 UTC


@dataclass(frozen=True, slots=True)
class Marker:
    """A point in time that somebody marked."""

    id: int
    t_mono_ns: int
    t_wall_ns: int
    kind: str
    text: str
    who: str | None


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """Bytes between two delimiters of a serial link."""

    t_mono_ns: int
    t_wall_ns: int
    link: int
    raw: bytes
    ok: bool


@dataclass(frozen=True, slots=True)
class RecordedCanFrame:
    """A CAN frame; bit 31 of the id marks a 29-bit id. `bus` is 0 but in sessions of versions that read several."""

    t_mono_ns: int
    t_wall_ns: int
    can_id: int
    data: bytes
    bus: int = 0


@dataclass(frozen=True, slots=True)
class RecordedConfig:
    """A configuration in force from its time on."""

    t_mono_ns: int
    t_wall_ns: int
    why: str
    image: bytes
