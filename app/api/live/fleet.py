"""All cars of a broker."""

from typing import Any

from fastapi import APIRouter

from app.api.encoding.words import message_json
from app.api.schemas.fleet import FleetOut
from app.api.web.dependencies import FleetPart

router = APIRouter(tags=["fleet"])


@router.get("/fleet", response_model=FleetOut)
def fleet(fleet: FleetPart) -> dict[str, Any]:
    """Every car, by name; 404 unless the service was started with `--fleet`."""
    return {"broker": fleet.broker, "cars": fleet.cars(), **message_json("problem", fleet.problem)}
