"""A slave's readings against a reference meter: read, compare, keep, look back."""

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from app.api.schemas.page import PageOut
from app.api.web.dependencies import ClockPart, EventsPart, LinksPart, SlaveChecksPart, UserDep
from app.api.web.paging import CursorQuery, page_of
from app.api.web.problems import Problem
from app.api.web.request_body import Body
from app.battery.shape import CELLS_PER_PACK, N_PACKS
from app.configuration.slave_check import (
    QUANTITIES,
    CellReading,
    QuantityName,
    SlaveCheck,
    SlaveVerdict,
    judge,
    read_slave,
)
from app.telemetry import Severity
from app.words import Message, Pack

router = APIRouter(prefix="/calibration/slave", tags=["commands"])
MAX_CHECKS = 200
PackQuery = Annotated[int | None, Query(ge=0, lt=N_PACKS)]


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
    verdict: SlaveVerdict


class SlaveLimitsOut(BaseModel):
    """Tolerances of a slave, and the largest error of a meter that may judge it."""

    unit: str
    tolerance: float
    meter_error_max: float


class SlaveCheckResultOut(BaseModel):
    """The readings; with those of a meter also the check, and the one before it."""

    readings: list[CellReading]
    limits: SlaveLimitsOut
    check: SlaveCheckOut | None
    before: SlaveCheckOut | None


class SlaveChecksOut(PageOut):
    """Newest first."""

    checks: list[SlaveCheckOut]


class SlaveCheckIn(Body):
    """The slave to check; with the meter's readings it is judged and kept, without them only read."""

    pack: int = Field(ge=0, lt=N_PACKS)
    quantity: QuantityName = "voltage"
    reference: list[float | None] | None = Field(
        None, min_length=CELLS_PER_PACK, max_length=CELLS_PER_PACK, description="the meter's, cell 1 to 12 [V or degC]"
    )
    meter: str = Field("", max_length=80, description="which meter")
    meter_error: float = Field(0.0, ge=0, le=10, description="what it may be off itself [V or degC]")
    note: str = Field("", max_length=200)


def _limits(quantity: QuantityName) -> dict[str, Any]:
    limits = QUANTITIES[quantity]
    return {"unit": limits.unit, "tolerance": limits.tolerance, "meter_error_max": limits.meter_error_max}


def _check_json(check: SlaveCheck) -> dict[str, Any]:
    body = asdict(check)
    body["time"] = body.pop("t_wall_ns") / 1e9
    return body | {"unit": QUANTITIES[check.quantity].unit}


@router.get("", response_model=SlaveChecksOut)
def checks(
    slave_checks: SlaveChecksPart,
    pack: PackQuery = None,
    quantity: QuantityName | None = None,
    limit: Annotated[int, Query(ge=1, le=MAX_CHECKS)] = 50,
    cursor: CursorQuery = None,
) -> dict[str, Any]:
    """The checks that were kept, newest first."""
    kept = slave_checks.checks(pack, quantity)
    shown, following = page_of(kept, lambda check: (check.number, ""), limit, cursor)
    return {"checks": [_check_json(check) for check in shown], "next_cursor": following}


@router.post("", response_model=SlaveCheckResultOut)
def check(
    body: SlaveCheckIn,
    links: LinksPart,
    slave_checks: SlaveChecksPart,
    events: EventsPart,
    clock: ClockPart,
    user: UserDep,
) -> dict[str, Any]:
    """Average a slave's readings over a second, at rest; compare them with a meter's, and keep that."""
    readings = read_slave(links.master, body.pack, body.quantity)
    answer = {"readings": readings, "limits": _limits(body.quantity), "check": None}
    if body.reference is None:
        return answer | {"before": None}
    before = next(iter(slave_checks.checks(body.pack, body.quantity)), None)
    kept = _keep(slave_checks, events, clock, body, readings, user.name)
    return answer | {"check": _check_json(kept), "before": before and _check_json(before)}


def _keep(
    slave_checks: SlaveChecksPart,
    events: EventsPart,
    clock: ClockPart,
    body: SlaveCheckIn,
    readings: list[CellReading],
    who: str,
) -> SlaveCheck:
    verdict = judge(readings, body.reference or [], body.quantity, body.meter_error)
    words = body.meter.strip(), body.meter_error, body.note.strip()
    try:
        kept = slave_checks.append(clock.wall_ns(), who, body.pack, body.quantity, *words, verdict)
    except OSError as error:
        raise Problem(507, "storage", Message("check-not-kept", error=error.strerror)) from error
    severity: Severity = "warning" if verdict.out else "info"
    events.note(severity, "slave-check", _check_message(body, verdict), who)
    return kept


def _check_message(body: SlaveCheckIn, verdict: SlaveVerdict) -> Message:
    unit = QUANTITIES[body.quantity].unit
    compared = [cell for cell in verdict.cells if cell.error is not None]
    largest = max(compared, key=lambda cell: abs(cell.error or 0.0))
    cells = tuple(cell % CELLS_PER_PACK + 1 for cell in verdict.out)
    message = Message("out-of-tolerance", cells=cells) if cells else Message("in-tolerance")
    error = _signed(largest.error or 0.0, unit)
    quantity = Message("quantity-voltage") if body.quantity == "voltage" else Message("quantity-temperature")
    return Message(
        "slave-checked", pack=Pack(body.pack), quantity=quantity, n=len(compared), error=error, found=message
    )


def _signed(error: float, unit: str) -> str:
    return f"{1e3 * error:+.1f} mV" if unit == "V" else f"{error:+.1f} {unit}"
