"""What happened around a trip: the cell and its place, how far and how long beyond the limit, what the others did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, Literal

import numpy as np

from app.analysis.totals import number
from app.battery.shape import CELLS_PER_PACK
from app.estimation.arrays import FloatArray

BEFORE_S: Final = 10.0
AFTER_S: Final = 5.0
LONGEST_S: Final = 15.0  # from the first trigger to the last that still belongs to it
FAULTS: Final = ("cell-missing", "joint-loose", "charger-")  # warnings of the battery itself
_MEASURED: Final = ("voltage_min_v", "temperature_at_degc")
Quantity = Literal["voltage", "temperature", "current"]
_QUANTITIES: dict[str, Quantity] = {"V": "voltage", "degC": "temperature", "A": "current"}


@dataclass(frozen=True)
class Trigger:
    """An event that is worth a black box."""

    at_s: float  # unix time, as logged
    mono_s: float  # of the recording machine's monotonic clock
    code: str
    severity: str
    text: str
    cell: int | None = None
    value: float | None = None
    limit: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class Window:
    """Every sample around a trigger: (n,) and (n, n_cells), NaN where not measured."""

    mono_s: FloatArray
    current_a: FloatArray
    voltage_v: FloatArray
    temperature_degc: FloatArray
    soc: FloatArray
    fit: FloatArray  # 1: the master held the shutdown circuit closed
    load: FloatArray  # 1: relays closed


def is_trigger(severity: str, code: str) -> bool:
    """True for trips, and for warnings that tell of a fault in the battery."""
    return severity == "trip" or (severity == "warning" and code.startswith(FAULTS))


def incidents(triggers: Sequence[Trigger]) -> list[list[Trigger]]:
    """Return the triggers in groups: what follows within AFTER_S belongs to what was first."""
    groups: list[list[Trigger]] = []
    for trigger in sorted(triggers, key=lambda each: each.mono_s):
        group = groups[-1] if groups else None
        if group and trigger.mono_s - group[-1].mono_s <= AFTER_S and trigger.mono_s - group[0].mono_s <= LONGEST_S:
            group.append(trigger)
        else:
            groups.append([trigger])
    return groups


def main_trigger(group: Sequence[Trigger]) -> Trigger:
    """Return the first that names a cell or a limit, a trip before a warning; the very first where none does."""
    trips = [each for each in group if each.severity == "trip"] or list(group)
    return next((each for each in trips if each.limit is not None), trips[0])


def incident_id(trigger: Trigger) -> str:
    """Return a name that is the same whoever makes the black box: UTC time and what tripped."""
    at = datetime.fromtimestamp(round(trigger.at_s, 3), UTC)
    return f"{at.strftime('%Y%m%dT%H%M%S')}.{at.microsecond // 1000:03}Z-{trigger.code}"


def build(
    group: Sequence[Trigger],
    window: Window,
    *,
    session_id: str | None,
    config_hash: str | None,
    limits: dict[str, float],
) -> dict[str, Any]:
    """Return the black box as JSON holds it; times in seconds relative to the main trigger.

    Args:
        group: one of `incidents`.
        window: samples from BEFORE_S before the first trigger to AFTER_S after the last, as far as there are any.
        session_id: the recording that they are in, None without one.
        config_hash: of the configuration in force, None where it was not heard.
        limits: the configuration's limits by name, in units.
    """
    main = main_trigger(group)
    time_s = window.mono_s - main.mono_s
    quantity = _QUANTITIES.get(main.unit) if main.limit is not None else None
    side = None if quantity is None or main.value is None or main.limit is None else _side(main.value, main.limit)
    box: dict[str, Any] = {
        "id": incident_id(main),
        "session_id": session_id,
        "at": main.at_s,
        "code": main.code,
        "severity": main.severity,
        "text": main.text,
        "cell": main.cell,
        "value": main.value,
        "limit": main.limit,
        "unit": main.unit,
        "quantity": quantity,
        "side": side,
        "config_hash": config_hash,
        "limits": limits,
        "events": [
            {"t_s": each.mono_s - main.mono_s, "severity": each.severity, "code": each.code, "text": each.text}
            for each in group
        ],
        "is_complete": bool(time_s.size and time_s[0] <= -0.8 * BEFORE_S and time_s[-1] >= 0.9 * AFTER_S),
        "rate_hz": None if time_s.size < 2 else round(float(1.0 / max(np.median(np.diff(time_s)), 1e-3)), 2),
        "beyond": _beyond(main, quantity, side, time_s, window),
        "peers": _peers(main, quantity, side, time_s, window),
        "cells": _cells(time_s, window),
        "samples": _samples(time_s, window),
    }
    box["summary"] = summary(box)
    return box


def place(cell: int | None) -> str:
    """The name people use: pack 3, cell 7; empty for none."""
    return "" if cell is None else f"pack {cell // CELLS_PER_PACK + 1}, cell {cell % CELLS_PER_PACK + 1}"


def short_place(cell: int) -> str:
    """Pack and cell as 3/7, for where there is little room."""
    return f"{cell // CELLS_PER_PACK + 1}/{cell % CELLS_PER_PACK + 1}"


def summary(box: dict[str, Any]) -> list[str]:
    """Return what happened in a few sentences."""
    where = place(box["cell"])
    said = [f"{box['text'][:1].upper()}{box['text'][1:]}."]
    beyond, peers = box["beyond"], box["peers"]
    unit = box["unit"]
    if beyond is not None and beyond["since_s"] is not None:
        before = -beyond["since_s"]
        lasted = f"for {beyond['lasted_s']:.1f} s" if beyond["ended"] else f"for {beyond['lasted_s']:.1f} s and still"
        before_text = f", {before:.2f} s of them before the trip" if before > 0.0 else ""
        said.append(
            f"{(where or 'The accumulator').capitalize()} was beyond the limit of {box['limit']:g} {unit} {lasted}"
            f"{before_text}; at worst {beyond['worst']:g} {unit}."
        )
    elif beyond is not None:
        said.append(
            f"At the sampled rate the value was never seen beyond the limit; nearest {beyond['worst']:g} {unit}."
        )
    if peers is not None:
        others = "No other cell was" if peers["also_beyond"] == 0 else f"{peers['also_beyond']} more were"
        said.append(
            f"{others} beyond it. At the trip the other cells lay between {peers['low']:.4g} and {peers['high']:.4g}"
            f" {unit}, mean {peers['mean']:.4g}; this one was {peers['apart']:+.3g} {unit} from their mean."
        )
    current = box["cells"]["current_at_trip_a"]
    if current is not None:
        said.append(f"The current was {current:.1f} A at the trip.")
    opened = box["cells"]["opened_s"]
    if opened is not None:
        said.append(f"The shutdown circuit was seen open {opened:+.2f} s from the trip.")
    if not any(value is not None for name in _MEASURED for value in box["cells"][name]):
        said.append("No single cell was heard in this time: over CAN alone come totals and extremes, no cells.")
    if not box["is_complete"]:
        said.append("The samples do not cover the whole of the time around it.")
    return said


def _side(value: float, limit: float) -> Literal["low", "high"]:
    return "low" if value < limit else "high"


def _values(main: Trigger, quantity: Quantity | None, window: Window) -> FloatArray | None:
    """What the limit is about, over time: of the cell named, of all cells' worst, or the current."""
    if quantity == "current":
        return window.current_a
    if quantity is None or main.limit is None or main.value is None:
        return None
    table = window.voltage_v if quantity == "voltage" else window.temperature_degc
    if main.cell is not None:
        return table[:, main.cell]
    worst = np.fmin if _side(main.value, main.limit) == "low" else np.fmax
    return np.asarray(worst.reduce(table, axis=1))


def _beyond(
    main: Trigger, quantity: Quantity | None, side: str | None, time_s: FloatArray, window: Window
) -> dict[str, Any] | None:
    """How long the value was beyond its limit: the stretch at the trip, or the one that led up to it."""
    values = _values(main, quantity, window)
    if values is None or main.limit is None or side is None or not np.isfinite(values).any():
        return None
    worst = np.nanmin if side == "low" else np.nanmax
    is_beyond = (values < main.limit) if side == "low" else (values > main.limit)
    nothing = {"since_s": None, "lasted_s": None, "ended": None, "worst": float(worst(values))}
    near = np.flatnonzero(is_beyond & (time_s <= 1.0))
    if not near.size:
        return nothing
    last = first = int(near[-1])
    while first > 0 and is_beyond[first - 1]:
        first -= 1
    while last + 1 < len(values) and is_beyond[last + 1]:
        last += 1
    ended = last + 1 < len(values)
    end_s = time_s[last + 1] if ended else time_s[last]
    return {
        "since_s": float(time_s[first]),
        "lasted_s": float(end_s - time_s[first]),
        "ended": ended,
        "worst": float(worst(values[first : last + 1])),
    }


def _peers(
    main: Trigger, quantity: Quantity | None, side: str | None, time_s: FloatArray, window: Window
) -> dict[str, Any] | None:
    if main.cell is None or quantity not in ("voltage", "temperature") or not time_s.size or main.limit is None:
        return None
    table = window.voltage_v if quantity == "voltage" else window.temperature_degc
    row = table[int(np.abs(time_s).argmin())]
    others = np.delete(row, main.cell)
    known = others[np.isfinite(others)]
    if not known.size or not np.isfinite(row[main.cell]):
        return None
    beyond = known < main.limit if side == "low" else known > main.limit
    return {
        "low": float(known.min()),
        "mean": float(known.mean()),
        "high": float(known.max()),
        "apart": float(row[main.cell] - known.mean()),
        "also_beyond": int(beyond.sum()),
    }


def _cells(time_s: FloatArray, window: Window) -> dict[str, Any]:
    """Every cell before, at and during it."""
    nobody = [None] * window.voltage_v.shape[1]
    if not time_s.size:
        empty = ("voltage_before_v", "voltage_at_v", "voltage_min_v", "voltage_max_v", "temperature_at_degc", "soc_at")
        return dict.fromkeys(empty, nobody) | {"current_at_trip_a": None, "opened_s": None}
    at = int(np.abs(time_s).argmin())
    before = window.voltage_v[time_s < -5.0] if (time_s < -5.0).any() else window.voltage_v[:1]
    held = np.flatnonzero(window.fit == 1.0)
    opened = np.flatnonzero((window.fit == 0.0) & (np.arange(len(time_s)) > (held[0] if held.size else len(time_s))))
    count = np.isfinite(before).sum(axis=0)
    mean_before = np.where(count > 0, np.nansum(before, axis=0) / np.maximum(count, 1), np.nan)
    return {
        "voltage_before_v": _listed(mean_before, 4),
        "voltage_at_v": _listed(window.voltage_v[at], 4),
        "voltage_min_v": _listed(np.fmin.reduce(window.voltage_v, axis=0), 4),
        "voltage_max_v": _listed(np.fmax.reduce(window.voltage_v, axis=0), 4),
        "temperature_at_degc": _listed(window.temperature_degc[at], 1),
        "soc_at": _listed(window.soc[at], 4),
        "current_at_trip_a": number(float(window.current_a[at])),
        "opened_s": float(time_s[opened[0]]) if opened.size else None,
    }


def _samples(time_s: FloatArray, window: Window) -> dict[str, Any]:
    """Everything at full rate; tables are cell by cell."""
    return {
        "time_s": _listed(time_s, 4),
        "current_a": _listed(window.current_a, 2),
        "voltage_v": [_listed(cell, 4) for cell in window.voltage_v.T],
        "temperature_degc": [_listed(cell, 1) for cell in window.temperature_degc.T],
        "soc": [_listed(cell, 4) for cell in window.soc.T],
        "fit": _listed(window.fit, 0),
        "load": _listed(window.load, 0),
    }


def _listed(values: FloatArray, decimals: int) -> list[float | None]:
    return [value if value == value else None for value in np.round(values, decimals).tolist()]
