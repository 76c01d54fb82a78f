"""The limits of then: by a configuration image of the master, by a battery's profile, by signals that carry them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Final

import numpy as np

from app.battery.battery import Battery, SignalName
from app.estimation.arrays import FloatArray
from app.sessions.reading.reader import SessionFile
from app.telemetry import ProtectionLimits
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
    """Return the limits that a profile states as numbers, by the same names; `names_of_signals` has the others."""
    stated = {name: (battery.limits.get(of), sign) for name, (of, sign) in _OF_PROFILE.items()}
    return {name: sign * limit for name, (limit, sign) in stated.items() if isinstance(limit, float)}


def names_of_signals(battery: Battery) -> dict[str, tuple[str, float]]:
    """Return the limits that signals carry: by name the field of a session that holds it, and its sign."""
    return {
        name: (f"limit.{of}", sign)
        for name, (of, sign) in _OF_PROFILE.items()
        if isinstance(battery.limits.get(of), SignalName)
    }


def known_limits(limits: ProtectionLimits | None) -> dict[str, float]:
    """Return the limits that a snapshot was judged by, by name, without missing ones."""
    if limits is None:
        return {}
    values = (
        limits.cell_voltage_min_v,
        limits.cell_voltage_max_v,
        limits.temperature_min_degc,
        limits.temperature_max_degc,
        limits.discharge_max_a,
        limits.discharge_min_a,
    )
    return {name: value for name, value in zip(LIMITS, values, strict=True) if isfinite(value)}


def by_names_of_profiles(limits: Mapping[str, float]) -> dict[str, float]:
    """Return limits by the names that profiles use."""
    return {of: sign * limits[name] for name, (of, sign) in _OF_PROFILE.items() if name in limits}


def limits_of(image: bytes | None) -> dict[str, float]:
    """Return what the configuration limits, by name, in units; empty where no configuration was received."""
    if image is None:
        return {}
    return {name: round(CONFIG[name].unpack(image)[0] * CONFIG[name].scale, 6) for name in LIMITS}


@dataclass(frozen=True)
class MovingLimit:
    """A limit that a signal carries: its value since each unix time, ascending; NaN before the first."""

    time_s: FloatArray  # (n,)
    value: FloatArray  # (n,)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the value at each time, NaN before the first one."""
        place = np.searchsorted(self.time_s, time_s, side="right") - 1
        if not len(self.value):
            return np.full(len(place), np.nan)
        return np.where(place >= 0, self.value[np.maximum(place, 0)], np.nan)


@dataclass(frozen=True)
class LimitsOverTime:
    """Limits by name: sets with the unix time since which each was in force, in order, and those that signals carry."""

    in_force: list[tuple[float, dict[str, float]]]
    moving: Mapping[str, MovingLimit] = field(default_factory=dict)

    def at(self, time_s: float = np.inf) -> dict[str, float]:
        """Return what was in force at a unix time [s], by name; at the end without one."""
        active: dict[str, float] = {}
        for since_s, limits in self.in_force:
            active = limits if since_s <= time_s else active
        values = {name: float(limit.at(np.array([time_s]))[0]) for name, limit in self.moving.items()}
        return active | {name: value for name, value in values.items() if np.isfinite(value)}


def limits_over_time(session: SessionFile, from_s: float | None = None, to_s: float | None = None) -> LimitsOverTime:
    """Read which limits were in force in a session, and when; those that signals carry between two unix times only."""
    configs = session.configs()
    if configs:
        return LimitsOverTime([(session.unix_s(config.t_mono_ns), limits_of(config.image)) for config in configs])
    carried = {name: of for name, of in names_of_signals(session.battery).items() if of[0] in session.signals.order}
    parts: dict[str, list[tuple[FloatArray, FloatArray]]] = {name: [] for name in carried}
    if carried:
        for samples in session.fields([signal for signal, _ in carried.values()], from_s, to_s):
            for name, (signal, sign) in carried.items():
                if signal in samples:
                    parts[name].append((samples[signal].time_s, sign * samples[signal].values[:, 0]))
    moving = {name: _changes(part) for name, part in parts.items() if part}
    return LimitsOverTime([(0.0, limits_of_profile(session.battery))], moving)


def _changes(parts: list[tuple[FloatArray, FloatArray]]) -> MovingLimit:
    """The times at which the value became another one; where it is missing the one before holds."""
    time_s, value = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    time_s, value = time_s[np.isfinite(value)], value[np.isfinite(value)]
    is_other = np.append(True, np.diff(value) != 0.0)[: len(value)]
    return MovingLimit(time_s[is_other], value[is_other])
