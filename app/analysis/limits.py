"""The limits of then: what a configuration image of the master, or a battery's profile, says they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from app.battery.battery import Battery
from firmware_protocol.memory_map import CONFIG

LIMITS: Final = ("v_cell_min", "v_cell_max", "t_cell_min", "t_cell_max", "i_disc_max", "i_disc_min")


_OF_PROFILE: Final = {  # name of a limit here, in a profile, and its sign
    "v_cell_min": ("cell_voltage_min_v", 1.0),
    "v_cell_max": ("cell_voltage_max_v", 1.0),
    "t_cell_min": ("temperature_min_degc", 1.0),
    "t_cell_max": ("temperature_max_degc", 1.0),
    "i_disc_max": ("discharge_current_max_a", 1.0),
    "i_disc_min": ("charge_current_max_a", -1.0),
}


def limits_of_profile(battery: Battery) -> dict[str, float]:
    """Return the limits that a profile states as numbers, by the same names; those that signals carry move."""
    stated = {name: (battery.limits.get(of), sign) for name, (of, sign) in _OF_PROFILE.items()}
    return {name: sign * limit for name, (limit, sign) in stated.items() if isinstance(limit, float)}


def by_names_of_profiles(limits: Mapping[str, float]) -> dict[str, float]:
    """Return limits by the names that profiles use."""
    return {of: sign * limits[name] for name, (of, sign) in _OF_PROFILE.items() if name in limits}


def limits_of(image: bytes | None) -> dict[str, float]:
    """Return what the configuration limits, by name, in units; empty where no configuration was received."""
    if image is None:
        return {}
    return {name: round(CONFIG[name].unpack(image)[0] * CONFIG[name].scale, 6) for name in LIMITS}
