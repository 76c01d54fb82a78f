"""All cars of a broker."""

from typing import Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel

from app import __version__
from app.api.schemas.snapshot import Number, Severity
from app.api.web.dependencies import FleetPart
from app.words import RenderedMessage, rendered, rendered_or_none

router = APIRouter(tags=["fleet"])
alone = APIRouter(tags=["fleet"])  # routes of a service without a car of its own


class CarLinkOut(BaseModel):
    """A link of a car to its master."""

    state: str
    lost: int


class CarAlarmOut(BaseModel):
    """An alarm as the car published it; the cell's index counts from 0."""

    severity: Severity
    message: RenderedMessage
    cell: int | None
    active: bool


class LastOut(BaseModel):
    """A number that a car does not measure now, as it last was; `age_s` is null where only the car's clock dates it."""

    value: float
    cell: int | None
    age_s: Number
    since: float


class CarOut(BaseModel):
    """A car as it was last received; `since` is the unix time of its last values, null and missing are never 0."""

    name: str
    state: Literal["live", "late", "silent", "vanished"]
    since: Number
    age_s: Number
    soc: Number
    soc_min: Number
    soc_min_cell: int | None
    voltage_v: Number
    voltage_at_least_v: Number
    current_a: Number
    voltage_min_v: Number
    voltage_min_cell: int | None
    temperature_max_degc: Number
    temperature_max_cell: int | None
    last_known: dict[str, LastOut]
    links: dict[str, CarLinkOut]
    master: str | None
    alarms: list[CarAlarmOut]
    url: str | None
    battery: str | None
    segments: list[int]
    simulated: bool


class FleetOut(BaseModel):
    """All cars of a broker, by name; `problem` says why none is received, `notice` that messages were left out."""

    broker: str
    problem: RenderedMessage | None
    notice: RenderedMessage | None
    cars: list[CarOut]


@alone.get("/health")
def health(fleet: FleetPart) -> dict[str, Any]:
    """Return whether the broker answers; the container asks."""
    problem = fleet.problem
    reasons = [] if problem is None else [problem]
    status = "degraded" if reasons else "ok"
    return {"status": status, "version": __version__, "source": "fleet", "reasons": [*map(rendered, reasons)]}


@router.get("/fleet", response_model=FleetOut)
def fleet(fleet: FleetPart) -> dict[str, Any]:
    """Every car, by name; 404 unless the service was started with `--fleet`."""
    return {
        "broker": fleet.broker,
        "cars": fleet.cars(),
        "problem": rendered_or_none(fleet.problem),
        "notice": rendered_or_none(fleet.notice),
    }
