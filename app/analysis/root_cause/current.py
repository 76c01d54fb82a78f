"""Hypotheses about the current: too much of it, or a sensor that says so."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from app.analysis.root_cause.recording import Recording, Suspicion
from app.estimation.cell_model.circuit import CellModel
from app.words import Message, Quantity

OFFSET_A: Final = 1.5  # beyond the sensor's own zero
STILL_A: Final = 1.5
SAGS: Final = 0.5  # of what the current would make the cells sag: more is a real current
BACK_S: Final = 20.0


def current_suspicions(recording: Recording, model: CellModel) -> Iterator[Suspicion]:
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


def _resistance(recording: Recording, usual_ohm: float) -> float:
    """Of the median cell, by what its voltage does when the current moves; the cell file's where it hardly moves."""
    step_a, step_v = recording.steady_a[3:] - recording.steady_a[:-3], recording.middle_v[3:] - recording.middle_v[:-3]
    known = np.isfinite(step_a) & np.isfinite(step_v) & (np.abs(step_a) > 5.0) & (np.abs(step_a) < 200.0)
    if known.sum() < 50:
        return usual_ohm
    return float(np.clip(np.median(-step_v[known] / step_a[known]), 2e-4, 2e-2))


def _offset(recording: Recording, load: np.ndarray, amps: np.ndarray) -> Iterator[Suspicion]:
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
        yield Suspicion("current-sensor-open", _jump(recording, amps, level), 60.0, evidence)
        return
    yield Suspicion("current-sensor-offset", _jump(recording, amps, level), 40.0, evidence)


def _jump(recording: Recording, amps: np.ndarray, level: float) -> float:
    """When the current stepped by about this much while the cells did not follow; else the start of the stretch."""
    step_a = np.diff(amps)
    step_v = np.diff(recording.middle_v)
    with np.errstate(invalid="ignore"):
        like = (np.abs(step_a - level) < 0.5 * abs(level)) & (np.abs(step_v) < 0.4e-3 * abs(level) + 2e-3)
    rows = np.flatnonzero(like)
    return float(recording.time_s[rows[0]]) if rows.size else recording.start_s


def _beyond(recording: Recording, at_s: float, ohm: float) -> Iterator[Suspicion]:
    """A trip by current: the cells sag with a real one."""
    rows = recording.near(at_s - 1.0, at_s + 0.2)
    earlier = recording.near(at_s - BACK_S, at_s - 1.0)
    if rows.stop - rows.start < 3 or earlier.stop - earlier.start < 3:
        return
    at = rows.start + int(np.nanargmax(np.abs(recording.steady_a[rows])))
    amps = float(recording.steady_a[at])
    expected = ohm * (amps - float(np.nanmedian(recording.steady_a[earlier])))
    seen = float(np.nanmedian(recording.middle_v[earlier]) - recording.middle_v[at])
    share = seen / expected if abs(expected) > 1e-3 else 1.0
    current = Quantity(amps, "A", 0)
    if share > SAGS:
        sag = Quantity(1000 * seen, "mV", 0)
        yield Suspicion("overload", at_s - 2.0, 25.0, (Message("seen-overload", current=current, sag=sag),))
        return
    evidence = (Message("seen-no-sag", current=current),)
    still = recording.steady_a[recording.near(at_s, at_s + 3.0)]
    if abs(amps) > 200.0 and still.size > 10 and float(np.std(still)) < STILL_A and abs(float(still.mean())) > 200.0:
        yield Suspicion("current-sensor-open", at_s - 2.0, 60.0, evidence)
    else:
        yield Suspicion("current-sensor-offset", at_s - 2.0, 40.0, evidence)
