"""Several cars."""

from typing import Literal

from pydantic import BaseModel

from app.api.schemas.snapshot import Number, Severity
from app.api.schemas.words import WordsOut


class CarLinkOut(BaseModel):
    """A link of a car to its master."""

    state: str
    lost: int


class CarAlarmOut(BaseModel):
    """An alarm as the car told it; the cell's index counts from 0."""

    severity: Severity
    text: str
    text_words: WordsOut | None
    cell: int | None
    active: bool


class CarOut(BaseModel):
    """A car as it was last heard; `since` is the unix time of its last values, null and missing are never 0."""

    name: str
    state: Literal["live", "late", "silent", "vanished"]
    since: Number
    age_s: Number
    soc: Number
    soc_min: Number
    soc_min_cell: int | None
    voltage_v: Number
    current_a: Number
    voltage_min_v: Number
    voltage_min_cell: int | None
    temperature_max_degc: Number
    temperature_max_cell: int | None
    links: dict[str, CarLinkOut]
    master: str | None
    alarms: list[CarAlarmOut]
    url: str | None
    battery: str | None
    segments: list[int]
    simulated: bool


class FleetOut(BaseModel):
    """All cars of a broker, by name; `problem` says why none is heard, `notice` that messages were left out."""

    broker: str
    problem: str | None
    problem_words: WordsOut | None
    notice: str | None
    notice_words: WordsOut | None
    cars: list[CarOut]
