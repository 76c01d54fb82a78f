"""The battery that the service serves."""

from typing import Any, Literal

from fastapi import APIRouter

from app.api.encoding.battery import battery_json
from app.api.schemas.battery import BatteryOut, ServedOut
from app.api.web.battery_switch import ServedBattery
from app.api.web.dependencies import BatteryPart, ClockPart, LivePart, ServedPart, hindrance

router = APIRouter(tags=["live"])


@router.get("/battery", response_model=BatteryOut)
def battery(battery: BatteryPart, live: LivePart) -> dict[str, Any]:
    """Shape, drawing, sensors and limits of the battery, and whether its configuration can be written."""
    limits = None if live.snapshot is None else live.snapshot.limits
    source: Literal["master", "dbc"] = "master" if battery.speaks_dbc is None else "dbc"
    return battery_json(battery.battery, source, hindrance(battery), limits)


@router.get("/batteries", response_model=list[ServedOut])
def batteries(served: ServedPart, clock: ClockPart) -> list[dict[str, Any]]:
    """Every battery that this service reads, the first one first: where its pages are, and how it is."""
    return [_served_json(each, clock.monotonic_ns()) for each in served]


def _served_json(served: ServedBattery, now_ns: int) -> dict[str, Any]:
    snapshot = served.live.snapshot
    age_s = None if snapshot is None else snapshot.age_s.voltage
    if snapshot is not None and age_s is not None:
        age_s += max(0.0, (now_ns - snapshot.t_mono_ns) / 1e9)
    active = {alarm.severity for alarm in (() if snapshot is None else snapshot.alarms) if alarm.active}
    return {
        "name": served.battery.battery.name,
        "path": served.path,
        "voltage_age_s": age_s,
        "worst": next((severity for severity in ("trip", "warning", "watch") if severity in active), None),
    }
