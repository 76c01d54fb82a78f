"""The battery that the service serves."""

from typing import Any

from fastapi import APIRouter

from app.api.encoding.battery import battery_json
from app.api.schemas.battery import BatteryOut
from app.api.web.dependencies import BatteryPart, LivePart
from app.battery.source import SpeaksMaster
from app.words import Message

router = APIRouter(tags=["live"])


@router.get("/battery", response_model=BatteryOut)
def battery(battery: BatteryPart, live: LivePart) -> dict[str, Any]:
    """Shape, drawing, sensors and limits of the battery, and whether its configuration can be written."""
    is_master = isinstance(battery.source, SpeaksMaster)
    limits = None if live.snapshot is None else live.snapshot.limits
    why_not = None if is_master else Message("battery-not-writable")
    return battery_json(battery.battery, "master" if is_master else "dbc", why_not, limits)
