"""Lays pulse tests and drives on the SOC axis: stretches without gaps, rested points, capacity, reference SOC."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.errors import ModelError
from app.estimation.identify_slow import SlowCurves
from app.estimation.importer import GAP_STEPS, FloatArray, Recording

IntArray = NDArray[np.intp]

GAP_S: Final = 60.0  # a shorter hole in the record cannot hide a discharge
REST_S: Final = 600.0  # a rest this long ends near the OCV
REST_CURRENT_C: Final = 0.01  # below this a cell rests
START_REST_S: Final = 1.0  # what counts as rest at the start of a record, where the time before is not seen
REST_ERROR_V: Final = 0.003  # how far a rested voltage lies from the curve, relaxation and hysteresis together
COUNT_ERROR_FRAC: Final = 0.003  # drift of a laboratory's charge counter, of the charge moved
SPAN_MIN: Final = 0.2  # SOC a stretch has to cover to say something about the capacity
DISAGREEMENT_FRAC: Final = 0.015  # above this two capacities are worth a note
COARSE_SOC: Final = 0.002  # a soc column in larger steps is smoothed by the charge count


@dataclass(frozen=True)
class Part:
    """One recording with the SOC it is fitted on; `soc` is (n,), `stretches` are row ranges without unseen charge."""

    recording: Recording
    soc: FloatArray
    is_drive: bool


def stretches(recording: Recording) -> list[IntArray]:
    """Return the rows of each stretch in which no charge can have moved unseen."""
    steps = recording.step_s
    hole = steps > max(GAP_S, GAP_STEPS * recording.usual_step_s)
    idle = np.abs(recording.current_a) < 1e-3 * max(float(np.abs(recording.current_a).max()), 1e-9)
    hole[1:] &= ~(idle[1:] & idle[:-1]) | (steps[1:] > REST_S)
    return [rows for rows in np.split(np.arange(steps.size), np.flatnonzero(hole)) if rows.size]


def charge_ah(recording: Recording, rows: IntArray) -> FloatArray:
    """Return the (m,) charge drawn since the first of the rows [Ah], trapezoidal."""
    current, time_s = recording.current_a[rows], recording.time_s[rows]
    moved = np.cumsum(0.5 * (current[1:] + current[:-1]) * np.diff(time_s)) / 3600.0
    return np.concatenate(([0.0], moved))


def rested_rows(recording: Recording, rows: IntArray, capacity_ah: float) -> IntArray:
    """Return the rows at which the cell is near its OCV: ends of long rests, and a start at rest."""
    idle = np.abs(recording.current_a[rows]) < REST_CURRENT_C * capacity_ah
    edges = np.flatnonzero(np.diff(idle)) + 1
    found = []
    for run in np.split(rows, edges):
        lasted = recording.time_s[run[-1]] - recording.time_s[run[0]]
        starts = run[0] == rows[0]
        if idle[run[0] - rows[0]] and lasted >= (START_REST_S if starts else REST_S):
            measured = run[np.isfinite(recording.voltage_v[run])]
            found.extend(measured[-1:].tolist())
    return np.array(found, dtype=np.intp)


def capacity_from_column(recordings: Sequence[Recording]) -> float | None:
    """Return the capacity [Ah] that makes charge counts and soc columns agree, None without a column that says it."""
    moved = spanned = 0.0
    for recording in recordings:
        for rows in stretches(recording):
            known = np.flatnonzero(np.isfinite(recording.soc[rows]))
            if known.size < 2:
                continue
            low, high = rows[known[0]], rows[known[-1]]
            span = abs(float(recording.soc[low] - recording.soc[high]))
            if span >= SPAN_MIN:
                counted = charge_ah(recording, rows)
                moved += abs(float(counted[known[-1]] - counted[known[0]])) * span
                spanned += span * span
    return moved / spanned if spanned > 0.0 else None


def capacity_from_rests(recordings: Sequence[Recording], slow: SlowCurves) -> float | None:
    """Return the capacity [Ah] by charge counted between rested points on the OCV curve, None with too few of them."""
    moved = spanned = 0.0
    for recording in recordings:
        for rows in stretches(recording):
            rested = rested_rows(recording, rows, slow.counted_ah)
            if rested.size < 2:
                continue
            soc = _soc_at(slow, recording.voltage_v[rested])
            span = float(soc[0] - soc[-1])
            if abs(span) >= SPAN_MIN:
                counted = charge_ah(recording, rows)[rested - rows[0]]
                moved += float(counted[-1] - counted[0]) * span
                spanned += span * span
    return moved / spanned if spanned >= 2.0 * SPAN_MIN**2 else None


def choose_capacity(slow: SlowCurves, recordings: Sequence[Recording], notes: list[str]) -> float:
    """Return the capacity [Ah]: the soc columns', else the rested points', else the slow test's own count."""
    for capacity, origin in (
        (capacity_from_column(recordings), "the soc columns of the other tests"),
        (capacity_from_rests(recordings, slow), "the rested points of the other tests"),
    ):
        if capacity is None or not 0.5 < capacity / slow.counted_ah < 2.0:
            continue
        if abs(capacity / slow.counted_ah - 1.0) > DISAGREEMENT_FRAC:
            notes.append(
                f"the slow test counts {slow.counted_ah:.4g} Ah, {origin} say {capacity:.4g} Ah: those are taken"
            )
        return capacity
    return slow.counted_ah


def reference_soc(recording: Recording, capacity_ah: float, slow: SlowCurves, notes: list[str]) -> FloatArray:
    """Return the (n,) SOC of a recording: its soc column, else the charge count laid on the rested points.

    Raises:
        ModelError: a recording without a soc column has a stretch that never rests.
    """
    known = np.isfinite(recording.soc)
    if known.mean() > 0.5 and not _is_coarse(recording.soc[known]):
        return np.interp(np.arange(known.size), np.flatnonzero(known), recording.soc[known])
    soc = np.full(known.size, np.nan)
    unplaced = 0
    for rows in stretches(recording):
        drawn = charge_ah(recording, rows) / capacity_ah
        if known[rows].any():
            start = float(np.median((recording.soc[rows] + drawn)[known[rows]]))
        else:
            rested = rested_rows(recording, rows, capacity_ah)
            if rested.size == 0:
                unplaced += rows.size
                continue
            at = drawn[rested - rows[0]]
            start = _start_from_rests(slow, recording.voltage_v[rested], at)
        soc[rows] = start - drawn
    if unplaced == known.size:
        raise ModelError(recording.source, "has no soc column and never rests: its SOC cannot be placed")
    if unplaced:
        notes.append(f"{recording.source}: {unplaced} rows lie between gaps and never rest: not used")
    return soc


def _start_from_rests(slow: SlowCurves, voltage_v: FloatArray, drawn: FloatArray) -> float:
    """Return the SOC at the start of a stretch: rested points weighted by how sharply each of them tells it."""
    soc = _soc_at(slow, voltage_v)
    slope = np.interp(soc, slow.soc, np.gradient(0.5 * (slow.discharge_v + slow.charge_v), slow.soc))
    gap_v = np.interp(soc, slow.soc, slow.charge_v - slow.discharge_v)
    error = np.hypot(REST_ERROR_V, 0.25 * gap_v) / np.maximum(slope, 1e-3)
    weight = 1.0 / (error**2 + (COUNT_ERROR_FRAC * np.abs(drawn - drawn[0])) ** 2)
    return float(np.sum(weight * (soc + drawn)) / np.sum(weight))


def _soc_at(slow: SlowCurves, voltage_v: FloatArray) -> FloatArray:
    """Return the SOC of rested voltages on the curve that a rest after a discharge ends on."""
    rising = slow.rested_v + 1e-9 * np.arange(slow.soc.size)
    return np.interp(voltage_v, rising, slow.soc)


def _is_coarse(soc: FloatArray) -> bool:
    steps = np.abs(np.diff(soc))
    steps = steps[steps > 0.0]
    return bool(steps.size) and float(np.median(steps)) > COARSE_SOC
