"""Hypotheses about the relays, the pre-charge and the vehicle's link, and about the current or a sensor that shows it.

The accumulator sees only its own current: a pre-charge shows as the charge that fills the link's capacitor.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from app.analysis.root_cause.recording import Hypothesis, SessionStretch
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.words import Message, Quantity

LOADED_A: Final = 5.0  # nobody switches high voltage off at more
BEFORE_S: Final = 1.0  # a car that drives is never without current for so long, one switched off at rest is
TRY_S: Final = 2.6  # a little less than a pre-charge lasts that gives up
TRY_A: Final = 0.045  # mean over it: five times the noise
INRUSH_S: Final = 2.0
INRUSH_COULOMB: Final = 0.1  # less than half of what fills the capacitor of a car's inverters
REOPENED_S: Final = 8.0  # within so long the link may still hold its charge


def relay_hypotheses(recording: SessionStretch) -> Iterator[Hypothesis]:
    """Yield why the relays opened or did not close without a trip."""
    load, fit = recording.bit("load"), recording.bit("fit")
    if recording.time_s.size < 20 or not np.isfinite(load).any():
        return
    zero_a = _zero(recording, load)
    yield from _opened(recording, load, fit)
    yield from _never_closed(recording, load, fit, zero_a)
    yield from _not_discharged(recording, load)


def _zero(recording: SessionStretch, load: np.ndarray) -> float:
    """What the sensor shows without current [A]."""
    is_open = (load == 0.0) & (recording.charger_state <= 0)
    still = recording.steady_a[is_open & np.isfinite(recording.steady_a)]
    return float(np.median(still)) if still.size >= 5 else 0.0


def _measured(amps: FloatArray) -> FloatArray:
    return amps[np.isfinite(amps)]


def _opened(recording: SessionStretch, load: np.ndarray, fit: np.ndarray) -> Iterator[Hypothesis]:
    for row in np.flatnonzero((load[:-1] == 1.0) & (load[1:] == 0.0)) + 1:
        at_s = float(recording.time_s[row])
        before, after = recording.near(at_s - BEFORE_S, at_s - 0.01), recording.near(at_s, at_s + 1.5)
        still = _measured(recording.steady_a[recording.near(at_s + 0.3, at_s + 1.5)])
        loaded = _measured(recording.steady_a[before])
        if not still.size or not loaded.size:
            continue
        most_a = float(np.abs(loaded - np.median(still)).max())
        was_reset = any(e.code == "boot" and abs(e.at_s - at_s) < 8.0 for e in recording.events)
        if most_a > LOADED_A and (fit[after] == 1.0).all() and not was_reset:
            evidence = (Message("seen-opened-under-load", current=Quantity(most_a, "A", 0)),)
            yield Hypothesis("external-shutdown", at_s - 1.0, 40.0, evidence)


def _tries(recording: SessionStretch, load: np.ndarray, zero_a: float) -> list[float]:
    """Instants in the middle of currents with open relays that last as long as a pre-charge that gives up."""
    is_open = (load == 0.0) & (recording.charger_state <= 0)
    amps = np.where(is_open, recording.steady_a - zero_a, np.nan)
    step_s = max(float(np.median(np.diff(recording.time_s))), 1e-2)
    width = max(round(TRY_S / step_s), 5)
    if amps.size < 4 * width:
        return []
    flows = np.convolve(np.nan_to_num(amps), np.ones(width) / width, "same")
    is_measured = np.convolve(np.isnan(amps), np.ones(width), "same") < 0.5
    around = np.maximum(np.roll(flows, int(1.6 * width)), np.roll(flows, -int(1.6 * width)))
    rows = np.flatnonzero(is_measured & (flows > TRY_A) & (np.abs(around) < 0.4 * flows))
    return [] if not rows.size else [float(recording.time_s[rows[int(flows[rows].argmax())]])]


def _never_closed(recording: SessionStretch, load: np.ndarray, fit: np.ndarray, zero_a: float) -> Iterator[Hypothesis]:
    for at_s in _tries(recording, load, zero_a):
        after = recording.near(at_s, at_s + 4.0)
        if (load[after] == 1.0).any() or (fit[after] != 1.0).any():
            continue
        rows = recording.near(at_s - 0.4 * TRY_S, at_s + 0.4 * TRY_S)
        amps = Quantity(float(np.mean(recording.steady_a[rows])) - zero_a, "A", 2)
        evidence = (Message("seen-precharge-loaded", current=amps),)
        yield Hypothesis("dc-link-load", at_s - TRY_S, 40.0, evidence)
        return
    for event in recording.events:
        if event.code != "faults-cleared":
            continue
        rows = recording.near(event.at_s - 20.0, event.at_s)
        tripped = any(e.severity == "trip" and e.at_s < event.at_s for e in recording.events)
        if rows.stop - rows.start > 20 and (load[rows] == 0.0).all() and (fit[rows] == 1.0).all() and not tripped:
            yield Hypothesis("contactors-not-closed", event.at_s - 20.0, 20.0, (Message("seen-cleared-without-trip"),))


def _not_discharged(recording: SessionStretch, load: np.ndarray) -> Iterator[Hypothesis]:
    closed = np.flatnonzero((load[:-1] == 0.0) & (load[1:] == 1.0)) + 1
    for row in closed:
        at_s = float(recording.time_s[row])
        before = recording.near(at_s - REOPENED_S, at_s - 0.01)
        opened_before = (load[: before.start] == 1.0).any()
        if before.stop - before.start < 40 or (load[before] != 0.0).any() or not opened_before:
            continue
        still = _measured(recording.steady_a[recording.near(at_s - REOPENED_S, at_s - INRUSH_S - 0.5)])
        if not still.size:
            continue
        rows = recording.near(at_s - INRUSH_S, at_s - 0.01)
        dt_s = np.diff(recording.time_s[rows], append=at_s)
        inrush = float(((recording.steady_a[rows] - still.mean()) * dt_s).sum())
        if inrush < INRUSH_COULOMB:
            evidence = (Message("seen-no-inrush", charge=Quantity(1000 * max(inrush, 0.0), "mC", 0)),)
            yield Hypothesis("dc-link-discharge-failed", at_s - 5.0, 25.0, evidence)


OFFSET_A: Final = 1.5  # beyond the sensor's own zero
STILL_A: Final = 1.5
SAGS: Final = 0.5  # share of the expected voltage drop: more is a real current
BACK_S: Final = 20.0
HELD: Final = 2  # samples for which a current that has ended may still be shown


def current_hypotheses(recording: SessionStretch, model: CellModel) -> Iterator[Hypothesis]:
    """Yield what current, cells and relays say of each other."""
    load = recording.bit("load")
    amps = recording.steady_a
    if recording.time_s.size < 20 or not np.isfinite(amps).any():
        return
    ohm = _resistance(recording, float(np.median(model.r0_ohm)))
    yield from _offset(recording, load, amps)
    for event in recording.events:
        if event.severity == "trip" and event.code in ("trip-discharge-overcurrent", "trip-charge-overcurrent"):
            yield from _beyond(recording, event.at_s, ohm)


def _resistance(recording: SessionStretch, usual_ohm: float) -> float:
    """Of the median cell, by what its voltage does when the current moves; the cell file's where it hardly moves."""
    step_a, step_v = recording.steady_a[3:] - recording.steady_a[:-3], recording.median_v[3:] - recording.median_v[:-3]
    is_usable = np.isfinite(step_a) & np.isfinite(step_v) & (np.abs(step_a) > 5.0) & (np.abs(step_a) < 200.0)
    if is_usable.sum() < 50:
        return usual_ohm
    return float(np.clip(np.median(-step_v[is_usable] / step_a[is_usable]), 2e-4, 2e-2))


def _offset(recording: SessionStretch, load: np.ndarray, amps: np.ndarray) -> Iterator[Hypothesis]:
    open_now = (load == 0.0) & (recording.charger_state <= 0) & np.isfinite(amps)
    since = np.concatenate(([False], open_now[:-1])) & open_now
    off = np.abs(amps) > OFFSET_A
    rows = np.flatnonzero(since & off)
    if rows.size < 20 or rows.size < 0.5 * (since & (recording.time_s >= recording.time_s[rows[0]])).sum():
        return
    level = float(np.median(amps[rows]))
    spread = float(np.std(amps[rows][-50:]))
    evidence = (Message("seen-current-open", current=Quantity(level, "A", 1)),)
    if abs(level) > 200.0 and spread < STILL_A:
        yield Hypothesis("current-sensor-open", _jump(recording, amps, level), 60.0, evidence)
        return
    yield Hypothesis("current-sensor-offset", _jump(recording, amps, level), 40.0, evidence)


def _jump(recording: SessionStretch, amps: np.ndarray, level: float) -> float:
    """When the current stepped by about this much while the cells did not follow; else the start of the stretch."""
    step_a = np.diff(amps)
    step_v = np.diff(recording.median_v)
    with np.errstate(invalid="ignore"):
        like = (np.abs(step_a - level) < 0.5 * abs(level)) & (np.abs(step_v) < 0.4e-3 * abs(level) + 2e-3)
    rows = np.flatnonzero(like)
    return float(recording.time_s[rows[0]]) if rows.size else recording.start_s


def _beyond(recording: SessionStretch, at_s: float, ohm: float) -> Iterator[Hypothesis]:
    """A trip by current: the cells sag with a real one."""
    rows = recording.near(at_s - 1.0, at_s + 0.2)
    earlier = recording.near(at_s - BACK_S, at_s - 1.0)
    if rows.stop - rows.start < 3 or earlier.stop - earlier.start < 3:
        return
    at = rows.start + int(np.nanargmax(np.abs(recording.steady_a[rows])))
    amps = float(recording.steady_a[at])
    expected = ohm * (amps - float(np.nanmedian(recording.steady_a[earlier])))
    sign = 1.0 if expected > 0.0 else -1.0
    sags = np.nanmedian(recording.median_v[earlier]) - recording.median_v[max(at - HELD, 0) : at + 1]
    seen = sign * float(np.nanmax(sign * sags))
    share = seen / expected if abs(expected) > 1e-3 else 1.0
    current = Quantity(amps, "A", 0)
    if share > SAGS:
        sag = Quantity(1000 * seen, "mV", 0)
        yield Hypothesis("overload", at_s - 2.0, 25.0, (Message("seen-overload", current=current, sag=sag),))
        return
    evidence = (Message("seen-no-sag", current=current),)
    still = recording.steady_a[recording.near(at_s, at_s + 3.0)]
    if abs(amps) > 200.0 and still.size > 10 and float(np.std(still)) < STILL_A and abs(float(still.mean())) > 200.0:
        yield Hypothesis("current-sensor-open", at_s - 2.0, 60.0, evidence)
    else:
        yield Hypothesis("current-sensor-offset", at_s - 2.0, 40.0, evidence)
