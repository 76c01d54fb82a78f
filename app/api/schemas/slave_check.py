"""What the check of a slave against a meter answers."""

from pydantic import BaseModel

from app.api.schemas.page import PageOut
from app.configuration.slave_check import QuantityName, Reading, Verdict


class SlaveCheckOut(BaseModel):
    """A check that was kept."""

    number: int
    time: float
    who: str
    pack: int
    quantity: QuantityName
    unit: str
    meter: str
    meter_error: float
    note: str
    verdict: Verdict


class SlaveLimitsOut(BaseModel):
    """What a slave may be off, and a meter at most, to judge it."""

    unit: str
    tolerance: float
    meter_error_max: float


class SlaveCheckResultOut(BaseModel):
    """What was read; with a meter's readings also the check, and the one before it."""

    readings: list[Reading]
    limits: SlaveLimitsOut
    check: SlaveCheckOut | None
    before: SlaveCheckOut | None


class SlaveChecksOut(PageOut):
    """Newest first."""

    checks: list[SlaveCheckOut]
