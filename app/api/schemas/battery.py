"""The battery that is served, or that a session was recorded of: shape, drawing, sensors, limits."""

from typing import Literal

from pydantic import BaseModel

from app.api.schemas.snapshot import Number, model_of
from app.api.schemas.words import WordsOut
from app.battery.battery import Drawing


class BatteryOut(BaseModel):
    """Cells count from 0 through the segments in order; `order` and `turned` name segments from 0."""

    name: str
    segments: list[int]
    parallel: int
    cell: str
    drawing: model_of(Drawing)  # type: ignore[valid-type]
    sensors: list[list[int]]
    limits: dict[str, Number]
    rules: dict[str, float]
    source: Literal["master", "dbc", "recording"]
    can_write: bool
    why_not: str | None
    why_not_words: WordsOut | None
