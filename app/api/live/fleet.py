"""All cars of a broker."""

from typing import Any

from fastapi import APIRouter

from app import __version__
from app.api.encoding.words import message_json, messages_json
from app.api.schemas.fleet import FleetOut
from app.api.web.dependencies import FleetPart

router = APIRouter(tags=["fleet"])
alone = APIRouter(tags=["fleet"])  # of a service that has no car of its own


@alone.get("/health")
def health(fleet: FleetPart) -> dict[str, Any]:
    """Whether the broker answers; the container asks."""
    problem = fleet.problem
    reasons = [] if problem is None else [problem]
    status = "degraded" if reasons else "ok"
    return {"status": status, "version": __version__, "source": "fleet"} | messages_json("reasons", reasons)


@router.get("/fleet", response_model=FleetOut)
def fleet(fleet: FleetPart) -> dict[str, Any]:
    """Every car, by name; 404 unless the service was started with `--fleet`."""
    texts = message_json("problem", fleet.problem) | message_json("notice", fleet.notice)
    return {"broker": fleet.broker, "cars": fleet.cars()} | texts
