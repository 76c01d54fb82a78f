"""Health, login, history, events, commands."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

from app.api.schemas.page import PageOut
from app.api.schemas.sessions import SessionEventOut
from app.api.schemas.snapshot import Number
from app.configuration.calibration import Measured, Proposal
from app.configuration.history import Action
from app.words import RenderedMessage


class FieldErrorOut(BaseModel):
    """A field at fault, its value and its limit."""

    field: str
    message: RenderedMessage
    element: int | None = None
    value: bool | float | str | None = None
    limit: RenderedMessage | None = None


class ProblemOut(BaseModel):
    """An RFC 9457 problem document; what else it carries depends on its type."""

    model_config = ConfigDict(extra="allow")

    type: str
    title: str
    status: int
    detail: str
    message: RenderedMessage | None = None
    errors: list[FieldErrorOut] = []


class HealthOut(BaseModel):
    """Health of the service; `reasons` lists what is missing."""

    status: Literal["ok", "degraded", "failing"]
    version: str
    uptime_s: float
    source: Literal["simulator", "serial", "can", "replay"]
    reasons: list[RenderedMessage]


class MeOut(BaseModel):
    """The signed-in user; null where nobody is."""

    role: Literal["viewer", "engineer", "chief"] | None
    name: str | None
    password_required: bool
    has_chief: bool


class HistoryOut(BaseModel):
    """Columns of one length; `time` in unix seconds."""

    time: list[float]
    series: dict[str, list[Number]]


class TrendOut(BaseModel):
    """Columns of one length, one row every ten seconds; balancing is the share of the time that the cell was bled."""

    time: list[float]
    series: dict[str, list[Number]]
    balanced_s: float


class LogEventOut(SessionEventOut):
    """An entry of the event log."""

    uptime_s: Number
    acknowledged_by: str | None


class EventsOut(PageOut):
    """Newest first."""

    events: list[LogEventOut]


class SignedRecordOut(BaseModel):
    """One change; `result` is `done`, `begun` where no outcome is known, or what went wrong."""

    number: int
    time: float
    who: str
    action: Action
    what: str
    reason: str
    result: str
    genuine: bool


class SignedLogOut(PageOut):
    """Records, newest first."""

    records: list[SignedRecordOut]
    all_genuine: bool


class AcknowledgedOut(BaseModel):
    """The user who acknowledged it."""

    acknowledged_by: str


class CommandsOut(BaseModel):
    """The names of the commands, and why some would be refused now."""

    commands: list[str]
    block_reasons: dict[str, RenderedMessage]


class DoneOut(BaseModel):
    """The master did it."""

    done: Literal[True]


class CalibrationOut(BaseModel):
    """A reading of the current sensor, and what would correct it."""

    measured: Measured
    proposal: Proposal | None
