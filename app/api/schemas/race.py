"""The race's plan, and what is sent to the driver's display."""

from typing import Literal

from pydantic import BaseModel

from app.api.schemas.words import WordsOut
from app.sources.links.driver_display import DriverMessage


class RacePlanOut(BaseModel):
    """What was asked for; what a lap may take is in the snapshot."""

    laps_to_go: int
    reserve_soc: float


class DriverFrameOut(BaseModel):
    """A frame that is sent."""

    id: int
    extended: bool
    length: int
    start_byte: int
    byte_order: Literal["little", "big"]
    period_ms: int


class DriverCanOut(BaseModel):
    """The two frames, null where not sent; what stands in them now."""

    target: DriverFrameOut | None
    message: DriverFrameOut | None
    shown: DriverMessage
    target_wh: float | None
    sent: int
    error: str | None
    error_words: WordsOut | None
    hindrance: str | None
    hindrance_words: WordsOut | None
