"""The part of a snapshot that is the service's and not the battery's: recording, replay, ids."""

from dataclasses import dataclass
from typing import Annotated, Literal

from app.telemetry.fields import LEFT_OUT, SentAs, Unit
from app.telemetry.snapshot import Number
from app.words import Message


@dataclass(frozen=True, slots=True)
class RecordingState:
    """The session being recorded."""

    session_id: str
    since_ns: Annotated[int, SentAs("since", 1e9)]
    frames: int
    bytes: int


@dataclass(frozen=True, slots=True)
class Stall:
    """A recording that does not reach the disk."""

    since_ns: Annotated[int, SentAs("since", 1e9)]
    reason: Message


@dataclass(frozen=True, slots=True)
class ReplayCompared:
    """State of charge as recorded and as recomputed, at the newest sample."""

    recorded_soc: Annotated[Number, Unit("1", "mean of the cells", None)]
    recorded_soc_min: Annotated[Number, Unit("1", "emptiest cell", None)]
    recomputed_soc: Annotated[Number, Unit("1", "mean of the cells", None)]
    recomputed_soc_min: Annotated[Number, Unit("1", "emptiest cell", None)]
    largest_difference: Annotated[Number, Unit("1", "of any cell", None)]
    largest_difference_cell: int | None


@dataclass(frozen=True, slots=True)
class Replay:
    """Position of a replay, and the filter and cell that recompute the estimates."""

    session_id: str
    position_s: Annotated[float, Unit("s", "since the session's start", None)]
    duration_s: Annotated[float, Unit("s", "of the session", None)]
    speed: float
    paused: bool
    finished: bool
    loop: tuple[float, float] | None
    filter: str
    cell: str
    estimates: Literal["recomputed", "recorded"]
    compared: ReplayCompared | None


@dataclass(frozen=True, slots=True)
class ServiceState:
    """The service at the instant at which a snapshot is sent."""

    recording: RecordingState | None
    replay: Replay | None
    last_event_id: int
    config_stored_hash: str | None
    sent_s: Annotated[Number, Unit("s", "service's monotonic clock when this was sent; null in a file", 3)] = None
    run: str | None = None  # run of that clock: times of another run count from elsewhere; null in a file
    not_recording: Annotated[Stall | None, LEFT_OUT] = None  # kept in memory up to a bound, or not at all
