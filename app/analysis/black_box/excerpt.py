"""The excerpt around a trip: the cell and its place, how far and how long beyond the limit, the other cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.analysis.black_box.box import (
    Beyond,
    BlackBox,
    BoxEvent,
    BoxSamples,
    CellsAround,
    Measured,
    Peers,
    Side,
    findings_of,
)
from app.analysis.incidents import AFTER_S, BEFORE_S, Trigger, incident_id, main_trigger
from app.analysis.totals import listed, number
from app.estimation.arrays import FloatArray
from app.words import rendered

_QUANTITIES: Final[dict[str, Measured]] = {"V": "voltage", "degC": "temperature", "A": "current"}


@dataclass(frozen=True)
class BoxWindow:
    """Every sample around a trigger: (n,) and (n, n_cells), NaN where not measured."""

    mono_s: FloatArray
    current_a: FloatArray
    voltage_v: FloatArray
    temperature_degc: FloatArray
    soc: FloatArray
    fit: FloatArray  # 1: the master held the shutdown circuit closed
    load: FloatArray  # 1: relays closed


def build(
    group: Sequence[Trigger],
    window: BoxWindow,
    *,
    session_id: str | None,
    config_hash: str | None,
    limits: dict[str, float],
    is_simulated: bool = False,
    segments: Sequence[int],
) -> BlackBox:
    """Return the black box of an incident.

    Args:
        group: one of `incidents`.
        window: samples from BEFORE_S before the first trigger to AFTER_S after the last, as far as there are any.
        session_id: the recording that they are in, None without one.
        config_hash: of the configuration in force, None where it was not received.
        limits: the configuration's limits by name, in units.
        is_simulated: the car was the simulator.
        segments: cells of each pack.
    """
    main = main_trigger(group)
    time_s = window.mono_s - main.mono_s
    quantity = _QUANTITIES.get(main.unit) if main.limit is not None else None
    side = None if quantity is None or main.value is None or main.limit is None else _side(main.value, main.limit)
    box = BlackBox(
        id=incident_id(main),
        session_id=session_id,
        at=main.at_s,
        code=main.code,
        severity=main.severity,
        message=rendered(main.message, segments),
        cell=main.cell,
        value=main.value,
        limit=main.limit,
        unit=main.unit,
        quantity=quantity,
        side=side,
        config_hash=config_hash,
        limits=limits,
        segments=list(segments),
        events=[
            BoxEvent(trigger.mono_s - main.mono_s, trigger.severity, trigger.code, rendered(trigger.message, segments))
            for trigger in group
        ],
        is_complete=bool(time_s.size and time_s[0] <= -0.8 * BEFORE_S and time_s[-1] >= 0.9 * AFTER_S),
        rate_hz=None if time_s.size < 2 else round(float(1.0 / max(np.median(np.diff(time_s)), 1e-3)), 2),
        beyond=_beyond(main, quantity, side, time_s, window),
        peers=_peers(main, quantity, side, time_s, window),
        cells=_cells(time_s, window),
        samples=_samples(time_s, window),
        findings=[],
        simulated=is_simulated,
    )
    return replace(box, findings=findings_of(box))


def _side(value: float, limit: float) -> Side:
    return "low" if value < limit else "high"


def _values(main: Trigger, quantity: Measured | None, window: BoxWindow) -> FloatArray | None:
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
    main: Trigger, quantity: Measured | None, side: Side | None, time_s: FloatArray, window: BoxWindow
) -> Beyond | None:
    """How long the value was beyond its limit: the stretch at the trip, or the one that led up to it."""
    values = _values(main, quantity, window)
    if values is None or main.limit is None or side is None or not np.isfinite(values).any():
        return None
    worst = np.nanmin if side == "low" else np.nanmax
    is_beyond = (values < main.limit) if side == "low" else (values > main.limit)
    near = np.flatnonzero(is_beyond & (time_s <= 1.0))
    if not near.size:
        return Beyond(None, None, None, float(worst(values)))
    last = first = int(near[-1])
    while first > 0 and is_beyond[first - 1]:
        first -= 1
    while last + 1 < len(values) and is_beyond[last + 1]:
        last += 1
    ended = last + 1 < len(values)
    end_s = time_s[last + 1] if ended else time_s[last]
    return Beyond(
        since_s=float(time_s[first]),
        lasted_s=float(end_s - time_s[first]),
        ended=ended,
        worst=float(worst(values[first : last + 1])),
    )


def _peers(
    main: Trigger, quantity: Measured | None, side: Side | None, time_s: FloatArray, window: BoxWindow
) -> Peers | None:
    if main.cell is None or quantity not in ("voltage", "temperature") or not time_s.size or main.limit is None:
        return None
    table = window.voltage_v if quantity == "voltage" else window.temperature_degc
    row = table[int(np.abs(time_s).argmin())]
    others = np.delete(row, main.cell)
    finite = others[np.isfinite(others)]
    if not finite.size or not np.isfinite(row[main.cell]):
        return None
    beyond = finite < main.limit if side == "low" else finite > main.limit
    return Peers(
        low=float(finite.min()),
        mean=float(finite.mean()),
        high=float(finite.max()),
        apart=float(row[main.cell] - finite.mean()),
        also_beyond=int(beyond.sum()),
    )


def _cells(time_s: FloatArray, window: BoxWindow) -> CellsAround:
    """Every cell before, at and during it."""
    if not time_s.size:
        nobody: list[float | None] = [None] * window.voltage_v.shape[1]
        return CellsAround(nobody, nobody, nobody, nobody, nobody, nobody, None, None)
    at = int(np.abs(time_s).argmin())
    before = window.voltage_v[time_s < -5.0] if (time_s < -5.0).any() else window.voltage_v[:1]
    held = np.flatnonzero(window.fit == 1.0)
    opened = np.flatnonzero((window.fit == 0.0) & (np.arange(len(time_s)) > (held[0] if held.size else len(time_s))))
    count = np.isfinite(before).sum(axis=0)
    mean_before = np.where(count > 0, np.nansum(before, axis=0) / np.maximum(count, 1), np.nan)
    return CellsAround(
        voltage_before_v=listed(mean_before, 4),
        voltage_at_v=listed(window.voltage_v[at], 4),
        voltage_min_v=listed(np.fmin.reduce(window.voltage_v, axis=0), 4),
        voltage_max_v=listed(np.fmax.reduce(window.voltage_v, axis=0), 4),
        temperature_at_degc=listed(window.temperature_degc[at], 1),
        soc_at=listed(window.soc[at], 4),
        current_at_trip_a=number(float(window.current_a[at])),
        opened_s=float(time_s[opened[0]]) if opened.size else None,
    )


def _samples(time_s: FloatArray, window: BoxWindow) -> BoxSamples:
    """Everything at full rate; tables are cell by cell."""
    return BoxSamples(
        time_s=listed(time_s, 4),
        current_a=listed(window.current_a, 2),
        voltage_v=[listed(cell, 4) for cell in window.voltage_v.T],
        temperature_degc=[listed(cell, 1) for cell in window.temperature_degc.T],
        soc=[listed(cell, 4) for cell in window.soc.T],
        fit=listed(window.fit, 0),
        load=listed(window.load, 0),
    )
