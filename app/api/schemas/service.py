"""Health, login, history, events, commands."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

from app.api.schemas.snapshot import Number, Severity
from app.api.schemas.words import WordsOut


class FieldErrorOut(BaseModel):
    """A field at fault, its value and its limit."""

    field: str
    message: str
    element: int | None = None
    value: bool | float | str | None = None
    limit: float | str | None = None


class ProblemOut(BaseModel):
    """An RFC 9457 problem document; what else it carries depends on its type."""

    model_config = ConfigDict(extra="allow")

    type: str
    title: str
    status: int
    detail: str
    detail_words: WordsOut | None = None
    errors: list[FieldErrorOut] = []


class HealthOut(BaseModel):
    """Whether the service does its work; `reasons` says what is missing."""

    status: Literal["ok", "degraded", "failing"]
    version: str
    uptime_s: float
    source: Literal["simulator", "serial", "can", "replay"]
    reasons: list[str]
    reasons_words: list[WordsOut]


class MeOut(BaseModel):
    """Who asks; null where nobody is logged in."""

    role: Literal["engineer", "viewer"] | None
    name: str | None
    password_required: bool


class HistoryOut(BaseModel):
    """Columns of one length; `time` in unix seconds."""

    time: list[float]
    series: dict[str, list[Number]]


class TrendOut(BaseModel):
    """Columns of one length, one row every ten seconds; balancing is the share of the time that the cell was bled."""

    time: list[float]
    series: dict[str, list[Number]]
    balanced_s: float


class LogEventOut(BaseModel):
    """An entry of the event log."""

    id: int
    time: float
    uptime_s: Number
    severity: Severity
    code: str
    text: str
    text_words: WordsOut | None
    cell: int | None
    value: Number
    limit: Number
    unit: str
    who: str | None
    acknowledged_by: str | None


class EventsOut(BaseModel):
    """Newest first."""

    events: list[LogEventOut]


class AcknowledgedOut(BaseModel):
    """Who saw it."""

    acknowledged_by: str


class CommandsOut(BaseModel):
    """The names of the commands, and why some would be refused now."""

    commands: list[str]
    hindrances: dict[str, str]
    hindrances_words: dict[str, WordsOut]


class DoneOut(BaseModel):
    """The master did it."""

    done: Literal[True]


class IdentityOut(BaseModel):
    """Who the master says it is."""

    firmware: str
    protocol: int
    map_hash: str
    is_compatible: bool
    boots: int


class MeasuredOut(BaseModel):
    """The current by the master, averaged; positive on discharge."""

    mean_a: float
    sigma_a: float
    samples: int
    relays_closed: bool


class ProposalOut(BaseModel):
    """What to change, in raw counts, and what the same reading would be then."""

    field: Literal["i_offset", "i_gain"]
    before_raw: int
    after_raw: int
    before_a: float
    after_a: float


class CalibrationOut(BaseModel):
    """A reading of the current sensor, and what would correct it."""

    measured: MeasuredOut
    proposal: ProposalOut | None
