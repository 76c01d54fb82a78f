"""Laps, events and findings of a session."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True)
class Lap:
    """One lap; None where not measured.

    Attributes:
        number: from 1.
        start, end: in UTC.
        driver: who drove; empty where unknown.
        counts: False for an out-lap, an incident or a partial lap.
        energy_out_wh, energy_in_wh: discharged, and charged by braking [Wh].
        power_mean_w, power_max_w: [W].
        soc_used: mean SOC at its begin less at its end, 0..1.
        temperature_max_degc: of the hottest cell, `temperature_max_cell` [degC].
        voltage_min_v: of the weakest cell, `weakest_cell` [V].
        is_partial: cut off by the end of the recording, or by a stop before the line.
    """

    number: int
    start: datetime
    end: datetime
    driver: str
    counts: bool
    energy_out_wh: float | None
    energy_in_wh: float | None
    power_mean_w: float | None
    power_max_w: float | None
    soc_used: float | None
    temperature_max_degc: float | None
    temperature_max_cell: int | None
    voltage_min_v: float | None
    weakest_cell: int | None
    is_partial: bool = False

    @property
    def duration_s(self) -> float:
        """Time of the lap [s]."""
        return (self.end - self.start).total_seconds()


@dataclass(frozen=True)
class Event:
    """An event; `value` and `limit` are in `unit`, None where it has none, `cell` None where it is of none."""

    time: datetime
    code: str
    severity: str
    text: str
    cell: int | None
    value: float | None
    limit: float | None
    unit: str


@dataclass(frozen=True)
class Finding:
    """A fault of one cell.

    Attributes:
        code: what it is, as `joint` or `capacity`.
        cell: index from 0.
        size: how much, in `unit`, with its band `low` to `high`; None where it has no size.
        since: when the evidence first sufficed, in UTC.
        confidence: probability that it is so.
        text: the same in English.
    """

    code: str
    cell: int
    size: float | None
    low: float | None
    high: float | None
    unit: str
    since: datetime
    confidence: float
    text: str
