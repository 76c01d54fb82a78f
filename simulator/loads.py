"""The loads of the accumulator: the interface, and every load that is not a race.

A load is a function of time and of the voltage it sees. It keeps no clock and no state of the cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from simulator.cell_data import FloatArray
from simulator.errors import ParameterError

_STARVED_V = 1.0  # below this a power load draws nothing: there is no battery


class Phase(Enum):
    """The phase of a drive, for the master's relays."""

    STANDBY = "standby"  # high voltage off
    READY = "ready"  # high voltage on, car still
    DRIVING = "driving"
    DRIVER_CHANGE = "driver change"  # high voltage off
    FINISHED = "finished"


@dataclass(frozen=True)
class LoadState:
    """The state of a load at one instant."""

    phase: Phase
    lap: int = 0  # from 1 while driving, the last one driven in pauses
    speed_m_per_s: float = 0.0

    @property
    def is_high_voltage_on(self) -> bool:
        """Return whether the car wants its relays closed."""
        return self.phase in (Phase.READY, Phase.DRIVING)


class ElectricalView(Protocol):
    """The values of the accumulator that a load may read."""

    @property
    def outlet_voltage_v(self) -> float:
        """Voltage at the accumulator's terminals after the last step [V]."""


class Load(Protocol):
    """Something that draws current."""

    @property
    def duration_s(self) -> float:
        """Time after which the load is over [s]; infinite if never."""

    def current_a(self, t_s: float, view: ElectricalView) -> float:
        """Return the current wanted `t_s` after the load began, positive on discharge [A]."""

    def state(self, t_s: float) -> LoadState:
        """Return where the load is at `t_s`."""


@dataclass(frozen=True)
class PowerLimits:
    """Limits of an inverter."""

    max_discharge_w: float = 60e3
    max_regeneration_w: float = 15e3
    max_discharge_a: float = 180.0
    max_regeneration_a: float = 45.0
    max_voltage_v: float = 401.0  # regeneration fades out over the last 6 V below this
    fade_v: float = 6.0

    def current_a(self, power_w: float, voltage_v: float) -> float:
        """Return the current for a wanted power at the present voltage, within the limits [A]."""
        if voltage_v < _STARVED_V:
            return 0.0
        power_w = min(max(power_w, -self.max_regeneration_w), self.max_discharge_w)
        current_a = min(max(power_w / voltage_v, -self.max_regeneration_a), self.max_discharge_a)
        if current_a < 0.0:
            current_a *= min(max((self.max_voltage_v - voltage_v) / self.fade_v, 0.0), 1.0)
        return current_a


@dataclass(frozen=True)
class ConstantCurrent:
    """The same current for a while."""

    amps: float
    duration_s: float = float("inf")

    def current_a(self, t_s: float, view: ElectricalView) -> float:
        """Return the current, 0 after the end [A]."""
        return self.amps if t_s < self.duration_s else 0.0

    def state(self, t_s: float) -> LoadState:
        """Return READY until the end."""
        return LoadState(Phase.READY if t_s < self.duration_s else Phase.FINISHED)


@dataclass(frozen=True)
class Idle:
    """High voltage on, the car does not move: inverters and cooling draw a small current."""

    watts: float = 250.0
    duration_s: float = float("inf")

    def current_a(self, t_s: float, view: ElectricalView) -> float:
        """Return the standing current [A]."""
        voltage_v = view.outlet_voltage_v
        return self.watts / voltage_v if voltage_v > _STARVED_V and t_s < self.duration_s else 0.0

    def state(self, t_s: float) -> LoadState:
        """Return READY until the end."""
        return LoadState(Phase.READY if t_s < self.duration_s else Phase.FINISHED)


@dataclass(frozen=True)
class Rest:
    """Relays open, nothing drawn."""

    duration_s: float = float("inf")

    def current_a(self, t_s: float, view: ElectricalView) -> float:
        """Return 0 [A]."""
        return 0.0

    def state(self, t_s: float) -> LoadState:
        """Return STANDBY until the end."""
        return LoadState(Phase.STANDBY if t_s < self.duration_s else Phase.FINISHED)


# Of the SOC thesis; the fifth entry of its menu lets the user type one, of which "manual" is an example.
# fmt: off
PATTERNS_C: dict[str, tuple[float, ...]] = {
    "hard": (7, 7, 7, 7, -7, -5, -2, 8, 10, 10, 10, 10, 10, 10, -10, -9, -7, -4, 1, 2, 2, 2, 2, 2, 2, 2, 4, 5, 5, -2,
             -5, -2, 8, 10, -2, -3, 5, 7, 7),
    "medium": (3, 3, 3, 3, -3, -2, -1, 4, 5, 5, 5, 5, 5, -5, -4, -3, -2, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, -1, -2, -1, 4,
               5, -1, -1, 2, 3, 3),
    "soft": (1, 1, 1, 1, -3, -2, -1, 2, 2, -2, -1, 2, 2, 2, -5, -4, -3, -2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -1, -2, -1,
             2, 2, -1, -1, 1, 1, 1),
    "constant": (1,),
    "manual": (4, 0, 4, 0, 6, 0, -2, 0),
}
# fmt: on


class Pattern:
    """A load pattern as in the SOC thesis: currents in C, each for an equal slice of the run."""

    def __init__(
        self, slices_c: tuple[float, ...], capacity_ah: float, *, depth: float = 0.8, scale: float = 1.0
    ) -> None:
        """Take the slices [C] once, times `scale`, so long that they draw `depth` of `capacity_ah` in sum.

        Raises:
            ParameterError: their sum is not a discharge.
        """
        self.amps: FloatArray = np.asarray(slices_c, dtype=float) * capacity_ah * scale
        total_a = float(self.amps.sum())
        if not total_a > 0.0 or not depth > 0.0:
            raise ParameterError("scale, depth", (scale, depth), "must make a discharge")
        self.slice_s = depth * capacity_ah * 3600.0 / total_a
        self.duration_s = self.slice_s * len(self.amps)

    def current_a(self, t_s: float, view: ElectricalView) -> float:
        """Return the current of the slice that `t_s` lies in [A]."""
        if not 0.0 <= t_s < self.duration_s:
            return 0.0
        return float(self.amps[min(int(t_s / self.slice_s), len(self.amps) - 1)])

    def state(self, t_s: float) -> LoadState:
        """Return DRIVING until the end."""
        return LoadState(Phase.DRIVING if t_s < self.duration_s else Phase.FINISHED, lap=1)


class Recorded:
    """A current over time from a file, and the ambient temperature if the file has it."""

    def __init__(self, time_s: FloatArray, current_a: FloatArray, ambient_degc: FloatArray | None = None) -> None:
        """Hold each (m,) current from its time to the next; time counts from the first sample.

        Raises:
            ParameterError: shapes differ, fewer than two samples, or time does not increase.
        """
        if time_s.shape != current_a.shape or len(time_s) < 2:
            raise ParameterError("time_s, current_a", (time_s.shape, current_a.shape), "two or more, equally many")
        if not np.all(np.diff(time_s) > 0.0):
            raise ParameterError("time_s", "not increasing", "must increase from row to row")
        self.time_s = time_s - time_s[0]
        self.amps = current_a
        self.ambient_degc = ambient_degc
        self.duration_s = float(self.time_s[-1])

    def current_a(self, t_s: float, view: ElectricalView) -> float:
        """Return the recorded current at `t_s`, 0 outside the record [A]."""
        if not 0.0 <= t_s <= self.duration_s:
            return 0.0
        return float(self.amps[np.searchsorted(self.time_s, t_s, side="right") - 1])

    def ambient_at_degc(self, t_s: float) -> float | None:
        """Return the recorded ambient temperature at `t_s`, or None if the file has none [degC]."""
        if self.ambient_degc is None:
            return None
        return float(np.interp(t_s, self.time_s, self.ambient_degc))

    def state(self, t_s: float) -> LoadState:
        """Return DRIVING until the end."""
        return LoadState(Phase.DRIVING if t_s <= self.duration_s else Phase.FINISHED, lap=1)
