"""What the check of a slave against a meter answers."""

from typing import Literal

from pydantic import BaseModel

Number = float | None


class SlaveReadingOut(BaseModel):
    """One cell by its slave, averaged; null where it has no measurement."""

    cell: int
    value: Number
    sigma: Number


class SlaveCellOut(BaseModel):
    """A reading beside the meter's."""

    cell: int
    value: Number
    sigma: Number
    reference: Number
    error: Number
    is_good: bool | None


class SlaveVerdictOut(BaseModel):
    """What the errors say together."""

    cells: list[SlaveCellOut]
    cause: Literal["none", "reference", "wire", "cells"]
    out: list[int]
    share: Number
    limit: float


class SlaveCheckOut(BaseModel):
    """A check that was kept."""

    number: int
    time: float
    who: str
    pack: int
    quantity: Literal["voltage", "temperature"]
    unit: str
    meter: str
    meter_error: float
    note: str
    verdict: SlaveVerdictOut


class SlaveLimitsOut(BaseModel):
    """What a slave may be off, and a meter at most, to judge it."""

    unit: str
    tolerance: float
    meter_error_max: float


class SlaveCheckResultOut(BaseModel):
    """What was read; with a meter's readings also the check, and the one before it."""

    readings: list[SlaveReadingOut]
    limits: SlaveLimitsOut
    check: SlaveCheckOut | None
    before: SlaveCheckOut | None


class SlaveChecksOut(BaseModel):
    """Newest first."""

    checks: list[SlaveCheckOut]
