"""First steps: what is plugged in, what was chosen, what a look at a port found."""

from pydantic import BaseModel

from app.api.schemas.snapshot import Number
from app.api.schemas.words import WordsOut


class ConnectionsOut(BaseModel):
    """With neither link the battery is simulated."""

    serial: str | None
    can: str | None
    battery: str


class FoundOut(BaseModel):
    """A port or an adapter, by the URL that the choice takes."""

    url: str
    description: str


class BatteryChoiceOut(BaseModel):
    """A battery that can be chosen by its id."""

    id: str
    name: str
    cells: int
    reads: str  # master or dbc
    uploaded: bool


class SetupOut(BaseModel):
    """`instance` is another one after each start; `fixed`: command line or environment say what is read."""

    instance: str
    needed: bool
    fixed: bool
    chosen: ConnectionsOut | None
    in_force: ConnectionsOut
    batteries: list[BatteryChoiceOut]


class PluggedOut(BaseModel):
    """What is plugged into the machine of the service."""

    serial: list[FoundOut]
    can: list[FoundOut]


class LookOut(BaseModel):
    """What arrived, and what to do where that is not right."""

    seconds: float
    bytes: int
    frames: int
    error: str | None
    error_words: WordsOut | None
    advice: str | None
    advice_words: WordsOut | None


class UploadedOut(BaseModel):
    """The id by which an uploaded battery can be chosen."""

    id: str


class LearnedCandidateOut(BaseModel):
    """A signal that may carry what a line says, and what was heard of it [in the line's unit]."""

    signal: str
    low: Number
    high: Number
    reasons: list[str]
    reasons_words: list[WordsOut | None]


class LearnedRunningOut(BaseModel):
    """What a line reads now: one value a cell or sensor, or one; of a state also its raw number and what that means."""

    values: list[Number]
    age_s: Number
    raw: int | None
    text: str


class LearnedLineOut(BaseModel):
    """One thing that the profile says: which of the candidates it is, whether it is taken, and what it reads."""

    key: str
    taken: bool
    signal: str
    candidates: list[LearnedCandidateOut]
    display_unit: str
    unit: str
    units: list[str]
    positive: str | None
    equals: list[int] | None
    running: LearnedRunningOut | None


class LearnedCheckOut(BaseModel):
    """A doubt about the profile, or an error with which it cannot work."""

    field: str
    is_error: bool
    what: str
    what_words: WordsOut | None


class LearnedOut(BaseModel):
    """A suggested profile; `profile` null where no cell voltages are recognised."""

    id: str
    frames: int
    messages: int
    heard: int
    cells: int
    segments: list[int]
    parallel: int
    sensors: int
    name: str
    lines: list[LearnedLineOut]
    doubts: list[str]
    doubts_words: list[WordsOut | None]
    checks: list[LearnedCheckOut]
    profile: str | None
