"""The battery that the service serves."""

from typing import Any, Literal

from fastapi import APIRouter

from app.api.encoding.battery import battery_json
from app.api.schemas.battery import BatteryOut
from app.api.web.dependencies import BatteryPart, LivePart, hindrance

router = APIRouter(tags=["live"])


@router.get("/battery", response_model=BatteryOut)
def battery(battery: BatteryPart, live: LivePart) -> dict[str, Any]:
    """Shape, drawing, sensors and limits of the battery, and whether its configuration can be written."""
    limits = None if live.snapshot is None else live.snapshot.limits
    source: Literal["master", "dbc"] = "master" if battery.speaks_dbc is None else "dbc"
    return battery_json(battery.battery, source, hindrance(battery), limits)
