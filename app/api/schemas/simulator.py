"""The simulated car."""

from typing import Literal

from pydantic import BaseModel

from app.api.schemas.snapshot import Number
from app.api.schemas.words import WordsOut


class FaultInForceOut(BaseModel):
    """A fault that acts now."""

    fault: str
    value: float
    since_s: float
    until_s: Number
    pack: int | None = None
    cell: int | None = None


class NoticeOut(BaseModel):
    """Something of the scenario that did not happen as it was planned, and when it should have."""

    at_s: float
    text: str
    text_words: WordsOut | None = None


class SimulatorStatusOut(BaseModel):
    """What happens in the simulated car; `speed` null: as fast as possible."""

    time_s: float
    speed: Number
    scenario: str
    phase: str
    lap: int
    soc: float
    current_a: float
    master_is_running: bool
    relays: Literal["open", "precharge", "precharge failed", "vehicle", "charger"]
    relays_since_s: float | None  # in the car's time; None while the master is off
    link_v: float  # of the vehicle's capacitor, behind the relays
    notices: list[NoticeOut]
    active: list[FaultInForceOut]


class ScenarioOut(BaseModel):
    """One of the library."""

    name: str
    title: str
    description: str


class UnreadableScenarioOut(BaseModel):
    """A scenario's file that cannot be used, and why."""

    name: str
    reason: str


class FaultKindOut(BaseModel):
    """What can go wrong."""

    name: str
    meaning: str
    area: str
    target: Literal["none", "pack", "cell"]
    unit: str
    minimum: float
    maximum: float
    default: float
    is_instant: bool


class SimulatorOut(BaseModel):
    """What happens, what else could, and what can go wrong."""

    scenario: str
    status: SimulatorStatusOut
    scenarios: list[ScenarioOut]
    unreadable: list[UnreadableScenarioOut]
    faults: list[FaultKindOut]


class FaultsInForceOut(BaseModel):
    """After the change."""

    active: list[FaultInForceOut]


class SpeedOut(BaseModel):
    """Times real time."""

    speed: float | Literal["max"]


class PhaseOut(BaseModel):
    """The phase that runs now."""

    phase: str


class UnpluggedOut(BaseModel):
    """Seconds without the cable."""

    for_s: float


class ScenarioStartedOut(BaseModel):
    """The scenario that runs now."""

    scenario: str
