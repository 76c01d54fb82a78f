"""Figures of a lap: energy, power, charge, heat, weakest cell; and drivers against each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.analysis.totals import Totals, energy_wh, first_last, number, present
from app.estimation.arrays import FloatArray

OVERLAY_POINTS = 400


@dataclass(frozen=True)
class Lap:
    """A stretch that counts as a lap, as found or as somebody settled it."""

    start_s: float  # unix time
    end_s: float
    driver: str = ""
    note: str = ""
    counts: bool = True  # False: an out-lap, an incident, a partial lap; not compared
    is_partial: bool = False  # cut off by the end of the recording, or by a stop before the line

    @property
    def duration_s(self) -> float:
        """Time of the lap."""
        return self.end_s - self.start_s


@dataclass(frozen=True)
class LapFigures:
    """One lap; None where not measured."""

    lap: Lap
    energy_out_wh: float | None
    energy_in_wh: float | None
    power_mean_w: float | None
    power_max_w: float | None
    power_min_w: float | None  # strongest regeneration, negative
    current_rms_a: float | None
    soc_used: float | None
    temperature_rise_k: float | None  # rise of the mean temperature
    temperature_max_degc: float | None
    temperature_max_cell: int | None
    voltage_min_v: float | None
    weakest_cell: int | None


@dataclass(frozen=True)
class DriverFigures:
    """Means of a driver's laps that count."""

    driver: str
    laps: int
    lap_s: float
    best_lap_s: float
    lap_spread_s: float  # standard deviation
    energy_out_wh: float | None
    energy_in_wh: float | None
    regenerated_share: float | None
    power_mean_w: float | None
    power_max_w: float | None
    soc_used: float | None
    temperature_rise_k: float | None


def figures_of(lap: Lap, totals: Totals) -> LapFigures:
    """Return what a lap cost out of the recording that holds it."""
    part = totals.between(lap.start_s, lap.end_s)
    power_w = part.power_w
    energies_wh = energy_wh(part.time_s, power_w)
    out_wh, in_wh = energies_wh or (None, None)
    watts = present(power_w)
    soc_first, soc_last = first_last(part.soc)
    cool, warm = first_last(part.t_mean_degc)
    low, weakest = _extreme(part.v_min_v, part.v_min_cell, np.nanargmin)
    hot, hottest = _extreme(part.t_max_degc, part.t_max_cell, np.nanargmax)
    amperes = present(part.current_a)
    return LapFigures(
        lap=lap,
        energy_out_wh=out_wh,
        energy_in_wh=in_wh,
        power_mean_w=float(watts.mean()) if energies_wh else None,
        power_max_w=float(watts.max()) if watts.size else None,
        power_min_w=float(watts.min()) if watts.size else None,
        current_rms_a=float(np.sqrt((amperes**2).mean())) if amperes.size else None,
        soc_used=None if soc_first is None or soc_last is None else soc_first - soc_last,
        temperature_rise_k=None if cool is None or warm is None else warm - cool,
        temperature_max_degc=hot,
        temperature_max_cell=hottest,
        voltage_min_v=low,
        weakest_cell=weakest,
    )


def with_drivers(laps: Sequence[Lap], changes: Sequence[tuple[float, str]]) -> list[Lap]:
    """Return the laps with the driver who had the car when they began; those named already keep theirs.

    Args:
        laps: in order.
        changes: when somebody took over, and who [s, name], in any order.
    """
    ordered = sorted(changes)
    named = []
    for lap in laps:
        middle_s = 0.5 * (lap.start_s + lap.end_s)
        who = [name for at_s, name in ordered if at_s <= middle_s]
        named.append(lap if lap.driver or not who else replace(lap, driver=who[-1]))
    return named


def compare_drivers(figures: Sequence[LapFigures]) -> list[DriverFigures]:
    """Return a line a driver over the laps that count, the quickest driver first."""
    names = dict.fromkeys(figure.lap.driver for figure in figures if figure.lap.counts)
    drivers = [_driver(name, [f for f in figures if f.lap.counts and f.lap.driver == name]) for name in names]
    return sorted(drivers, key=lambda driver: driver.lap_s)


def overlay(
    lap: Lap, time_s: FloatArray, values: FloatArray, points: int = OVERLAY_POINTS, share: FloatArray | None = None
) -> FloatArray:
    """Return (points, 2) smallest and largest value in equal parts of a lap, NaN where there is none.

    Args:
        lap: the span.
        time_s: (n,) rising.
        values: (n,).
        points: how many parts.
        share: (n,) how far round the lap the car is, 0..1; without it parts are of the lap's own duration. Either way
            laps of unequal length lie on each other place by place.
    """
    inside = (time_s >= lap.start_s) & (time_s < lap.end_s) & np.isfinite(values)
    result = np.full((points, 2), np.nan)
    if inside.any() and lap.duration_s > 0.0:
        share = (time_s - lap.start_s) / lap.duration_s if share is None else share
        part = (share[inside] * points).astype(np.int64).clip(0, points - 1)
        starts = np.flatnonzero(np.diff(part, prepend=-1))
        result[part[starts], 0] = np.minimum.reduceat(values[inside], starts)
        result[part[starts], 1] = np.maximum.reduceat(values[inside], starts)
    return result


def _driver(name: str, laps: Sequence[LapFigures]) -> DriverFigures:
    times_s = np.array([lap.lap.duration_s for lap in laps])
    out_wh = _mean([lap.energy_out_wh for lap in laps])
    in_wh = _mean([lap.energy_in_wh for lap in laps])
    peaks = [lap.power_max_w for lap in laps if lap.power_max_w is not None]
    return DriverFigures(
        driver=name,
        laps=len(laps),
        lap_s=float(times_s.mean()),
        best_lap_s=float(times_s.min()),
        lap_spread_s=float(times_s.std()),
        energy_out_wh=out_wh,
        energy_in_wh=in_wh,
        regenerated_share=in_wh / out_wh if in_wh is not None and out_wh else None,
        power_mean_w=_mean([lap.power_mean_w for lap in laps]),
        power_max_w=max(peaks) if peaks else None,
        soc_used=_mean([lap.soc_used for lap in laps]),
        temperature_rise_k=_mean([lap.temperature_rise_k for lap in laps]),
    )


def _mean(values: Sequence[float | None]) -> float | None:
    measured = [value for value in values if value is not None]
    return float(np.mean(measured)) if measured else None


def _extreme(values: FloatArray, cells: FloatArray, pick: object) -> tuple[float | None, int | None]:
    if not np.isfinite(values).any():
        return None, None
    at = int(pick(values))  # type: ignore[operator]
    cell = number(float(cells[at]))
    return float(values[at]), None if cell is None else int(cell)
