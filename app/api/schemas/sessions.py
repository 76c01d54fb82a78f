"""Sessions and replay."""

from typing import Any, Literal

from pydantic import BaseModel

from app.api.schemas.page import PageOut
from app.api.schemas.snapshot import Number, ReplayOut, Severity
from app.words import RenderedMessage


class SessionOut(BaseModel):
    """A recorded session; times in unix seconds."""

    id: str
    name: str
    started: float
    ended: Number
    duration_s: Number
    frames: int
    can_frames: int
    bytes: int
    recording: bool
    closed: bool
    event_count: int
    marker_count: int
    version: str
    metadata: dict[str, Any]


class UnreadableOut(BaseModel):
    """A file among the sessions that cannot be read, and why."""

    file: str
    reason: RenderedMessage


class SessionsOut(PageOut):
    """Newest first; with the first page the files that cannot be read."""

    sessions: list[SessionOut]
    unreadable: list[UnreadableOut]


class MarkerOut(BaseModel):
    """A note at an instant."""

    id: int
    time: float
    kind: str
    text: str
    who: str | None


class MarkersOut(PageOut):
    """Markers of a session, in order."""

    markers: list[MarkerOut]


class SessionEventOut(BaseModel):
    """An event as the session holds it."""

    id: int
    time: float
    severity: Severity
    code: str
    message: RenderedMessage
    cell: int | None
    value: Number
    limit: Number
    unit: str
    who: str | None


class StoredBoxOut(BaseModel):
    """A black box as a list shows it."""

    id: str
    time: float
    session_id: str | None
    code: str
    severity: Severity
    cell: int | None
    message: RenderedMessage
    is_complete: bool


class BoxList(PageOut):
    """Black boxes, the newest first."""

    boxes: list[StoredBoxOut]


class SessionConfigOut(BaseModel):
    """A configuration came into force."""

    time: float
    why: str


class SessionDetailOut(SessionOut):
    """One session with all that is in it."""

    markers: list[MarkerOut]
    events: list[SessionEventOut]
    configs: list[SessionConfigOut]
    signals: list[str]


class SignalSeriesOut(BaseModel):
    """Smallest and largest of each point; null is a gap."""

    unit: str
    time: list[float]
    min: list[Number]
    max: list[Number]


class SessionSeriesOut(BaseModel):
    """Signals over a range; `gaps` are intervals without data, `filled` those that came from another recorder."""

    signals: dict[str, SignalSeriesOut]
    gaps: list[tuple[float, float]]
    filled: list[tuple[float, float]]


class StoppedOut(BaseModel):
    """Recording stopped."""

    stopped: Literal[True]


class MarkedOut(BaseModel):
    """The marker is in the file."""

    marked: Literal[True]


class DeletedOut(BaseModel):
    """The session is gone."""

    deleted: Literal[True]


class ReplayStateOut(BaseModel):
    """Position of the replay; null: the live source is shown."""

    replay: ReplayOut | None  # type: ignore[valid-type]


class FetchOut(BaseModel):
    """Progress of a fetch from another service."""

    url: str
    is_running: bool
    session_id: str
    done_bytes: int
    total_bytes: int
    fetched: list[str]
    already_here: int
    filled: list[RenderedMessage]
    error: RenderedMessage | None


class FetchStateOut(BaseModel):
    """Null before the first fetch."""

    fetch: FetchOut | None


class RecordingPlanOut(BaseModel):
    """Names of the next sessions; empty by default."""

    event: str
    driver: str
    vehicle: str
    venue: str


class RecorderOut(BaseModel):
    """State of the recorder."""

    state: Literal["idle", "recording", "stalled"]
    session_id: str | None
    queued_items: int
    lost_items: int
    commit_delay_s: Number | None  # from a frame's arrival to its commit, the longest of the last minute
    disk_free_bytes: int | None
    stalled_since: Number | None  # nothing gets onto the disk; `error` says why
    warning: RenderedMessage | None
    error: RenderedMessage | None
    plan: RecordingPlanOut
    split_mb: int | None
    keep_days: Number
    keep_gb: Number


class ReplayChoicesOut(BaseModel):
    """Position of the replay, and the filters and cells that can recompute the estimates."""

    replay: ReplayOut | None  # type: ignore[valid-type]
    filters: list[str]
    cells: list[str]


class ImportMappingOut(BaseModel):
    """The column of each quantity; empty: not there."""

    time: str
    time_unit: str
    current: str
    current_unit: str
    charge_positive: bool
    current_means: str
    voltages: str
    voltage_unit: str
    cells: str
    cells_in_series: float
    temperatures: str
    temperature_unit: str
    soc: str
    soc_unit: str
    max_rate_hz: float
    hold_s: float
    bus: str


class UploadOut(BaseModel):
    """A file that came in, and the profile that its header suggests."""

    id: int
    filename: str
    is_can: bool
    columns: list[str]
    guessed: ImportMappingOut | None


class ColumnOut(BaseModel):
    """A column of a table, or a signal, with its first values."""

    name: str
    samples: list[float | None]


class CellColumnOut(BaseModel):
    """A column that fits the pattern of the voltages."""

    name: str
    median_v: float | None


class UnderstoodOut(BaseModel):
    """The first rows in our units, current positive on discharge; `soc` and temperatures empty where missing."""

    rows: int
    length_s: float
    started_unix_s: float | None
    time_s: list[float | None]
    current_a: list[float | None]
    soc: list[float | None]
    voltages_v: list[list[float | None]]
    temperatures_degc: list[list[float | None]]
    notes: list[RenderedMessage]


class PreviewOut(BaseModel):
    """Contents of an upload, and how the profile reads it; `understood` is null where `error` names the fault."""

    profile: ImportMappingOut
    columns: list[ColumnOut]
    cells: list[CellColumnOut]
    understood: UnderstoodOut | None
    error: RenderedMessage | None


class ImportStateOut(BaseModel):
    """Progress of an import: `done` of `total`; its rows once it is a session."""

    filename: str
    is_running: bool
    done: int
    total: int
    session_id: str | None
    notes: list[RenderedMessage]
    error: RenderedMessage | None


class ImportsOut(BaseModel):
    """The last import, null before the first, and the profiles that are kept."""

    last: ImportStateOut | None
    profiles: list[str]
