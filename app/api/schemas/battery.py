"""The battery that is served, or that a session was recorded of: shape, drawing, sensors, limits."""

from dataclasses import asdict
from typing import Any, Literal

from pydantic import BaseModel

from app.api.schemas.snapshot import Number, model_of
from app.battery.battery import LIMITS, Battery, Drawing, SignalName
from app.telemetry import ProtectionLimits
from app.words import Message, RenderedMessage, rendered_or_none


class BatteryOut(BaseModel):
    """Cells count through the packs from 0; `segments` are sizes of packs, `order` and `turned` name packs from 0.

    `has_checksum` is of the frames on its serial line, null without one.
    """

    name: str
    segments: list[int]
    parallel: int
    cell: str
    drawing: model_of(Drawing)  # type: ignore[valid-type]
    sensors: list[list[int]]
    limits: dict[str, Number]
    rules: dict[str, float]
    source: Literal["master", "dbc", "serial", "table", "recording"]
    has_checksum: bool | None
    can_write: bool
    why_not: RenderedMessage | None


def battery_json(
    battery: Battery,
    source: Literal["master", "dbc", "serial", "table", "recording"],
    why_not: Message | None,
    limits: ProtectionLimits | None = None,
    *,
    has_checksum: bool | None = None,
) -> dict[str, Any]:
    """Return the body of `GET battery`.

    Args:
        battery: drawn on the pages.
        source: how it is received.
        why_not: why nothing can be written to it; None where it can.
        limits: in force, for those that the profile does not state as numbers.
        has_checksum: of the frames on its serial line.
    """
    return {
        "name": battery.name,
        "segments": battery.segments,
        "parallel": battery.parallel,
        "cell": battery.cell,
        "drawing": asdict(battery.drawing),
        "sensors": battery.sensors,
        "limits": {name: _limit(battery, name, limits) for name in LIMITS},
        "rules": battery.rules,
        "source": source,
        "has_checksum": has_checksum,
        "can_write": why_not is None,
        "why_not": rendered_or_none(why_not),
    }


def _limit(battery: Battery, name: str, limits: ProtectionLimits | None) -> float | None:
    stated = battery.limits.get(name)
    if stated is not None and not isinstance(stated, SignalName):
        return stated
    limits_in_force = {} if limits is None else in_force(limits)
    value = limits_in_force.get(name)
    return None if value is None or value != value else value


def in_force(limits: ProtectionLimits) -> dict[str, float]:
    """Return protection limits by the names that profiles use; NaN where missing."""
    return {
        "cell_voltage_min_v": limits.cell_voltage_min_v,
        "cell_voltage_max_v": limits.cell_voltage_max_v,
        "temperature_min_degc": limits.temperature_min_degc,
        "temperature_max_degc": limits.temperature_max_degc,
        "discharge_current_max_a": limits.discharge_max_a,
        "charge_current_max_a": -limits.discharge_min_a,
        "pack_voltage_max_v": limits.accumulator_voltage_max_v,
        "segment_voltage_max_v": limits.pack_voltage_max_v,
    }
