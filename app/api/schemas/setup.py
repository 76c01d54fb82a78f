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


class LearnedLineOut(BaseModel):
    """One thing that was recognised: which signals carry it, what was heard of it [in its unit], and the reasons."""

    what: str
    signal: str
    low: Number
    high: Number
    unit: str
    reasons: list[str]
    reasons_words: list[WordsOut | None]


class LearnedOut(BaseModel):
    """A suggested profile; `profile` null where no cell voltages are recognised."""

    frames: int
    messages: int
    heard: int
    cells: int
    segments: list[int]
    sensors: int
    lines: list[LearnedLineOut]
    doubts: list[str]
    doubts_words: list[WordsOut | None]
    profile: str | None
