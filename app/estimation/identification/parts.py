"""Lays pulse tests and drives on the SOC axis: stretches without gaps, rested points, capacity, reference SOC."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray, IntArray
from app.estimation.errors import ModelError
from app.estimation.identification.branches import REST_S, stretches
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.recording.cell_recording import Recording
from app.estimation.recording.time_axis import usual_step

REST_SIGMA_V: Final = 0.003  # how near the OCV a rest of `REST_S` ends
SHORT_REST_S: Final = 60.0  # a rest this long ends not far from it
SHORT_REST_SIGMA_V: Final = 0.01
LOADED_SIGMA_V: Final = 0.015  # sigma of a first row under load, its ohmic drop given back
SLOPE_MIN_V: Final = 1e-3  # slope of the OCV over SOC: flatter has no information
UNSEEN_GAP_V: Final = 0.06  # between the branches where one alone is known: hysteresis of LFP
REFUTED_SIGMAS: Final = 2.0
FOREIGN_FRAC: Final = 0.5  # share of the charge moved: further apart than that, count and voltage are not of one cell
COUNT_DRIFT_FRAC: Final = 0.25  # share of the charge moved to and fro: a counter may be as bad as that
REST_CURRENT_C: Final = 0.01  # below this a cell rests

EDGE_STEP_S: Final = 30.0
EDGE_STEPS: Final = 2.0  # multiple of the usual step
EDGE_REST_FRAC: Final = 0.02  # share of the current at the other end: that is rest
COUNT_ERROR_FRAC: Final = 0.003  # drift of a laboratory's charge counter, of the charge moved
SPAN_MIN: Final = 0.2  # SOC that has to be covered to say something about the capacity
COLUMN_STEP_MIN: Final = 0.01  # share of SOC that one stretch with a soc column has to cover
COLUMN_ERROR_SOC: Final = 1e-4  # error of a soc column at either end of a stretch
UNSURE_RATIO: Final = 3.0  # between the errors of stretches that count alike
DISAGREEMENT_FRAC: Final = 0.015  # above this two capacities are worth a note
OcvShift = Callable[[FloatArray, FloatArray], FloatArray]  # (n,) SOC and temperature [degC] to (n,) volts
COARSE_SOC: Final = 0.002  # a soc column in larger steps is smoothed by the charge count


@dataclass(frozen=True)
class Part:
    """One recording with the SOC it is fitted on; `soc` is (n,), `stretches` are row ranges without unseen charge."""

    recording: Recording
    soc: FloatArray
    is_drive: bool


def current_between(time_s: FloatArray, current_a: FloatArray) -> FloatArray:
    """Return the (n,) current that flowed before each row since the one before it [A]: the mean of the two.

    Between a row under load and one at rest that lie far apart none flowed: rigs add a row where a step ends or begins.
    """
    before_a = np.concatenate((current_a[:1], current_a[:-1]))
    least, most = np.sort(np.abs([before_a, current_a]), axis=0)
    step_s = np.diff(time_s, prepend=time_s[:1])
    is_edge = (step_s > max(EDGE_STEP_S, EDGE_STEPS * usual_step(time_s))) & (least < EDGE_REST_FRAC * most)
    return np.where(is_edge, 0.0, 0.5 * (before_a + current_a))


def charge_ah(recording: Recording, rows: IntArray) -> FloatArray:
    """Return the (m,) charge drawn since the first of the rows [Ah]."""
    current, time_s = recording.current_a[rows], recording.time_s[rows]
    moved = np.cumsum(current_between(time_s, current)[1:] * np.diff(time_s)) / 3600.0
    return np.concatenate(([0.0], moved))


def edge_charge_ah(recording: Recording, rows: IntArray) -> float:
    """Return how far the charge between the first and last of the rows depends on when the current changed [Ah]."""
    current, time_s = recording.current_a[rows], recording.time_s[rows]
    return abs(float(np.sum(0.5 * np.diff(current) * np.diff(time_s)))) / 3600.0


@dataclass(frozen=True)
class Anchors:
    """Moments at which a stretch tells its OCV: row numbers, OCV [V] and how far that may be off [V]."""

    rows: IntArray
    ocv_v: FloatArray
    sigma_v: FloatArray


def find_anchors(recording: Recording, rows: IntArray, capacity_ah: float, resistance_ohm: float) -> Anchors:
    """Return the anchors of a stretch: ends of rests, and the first row of the record, which follows an unseen rest.

    Args:
        recording: the recording.
        rows: its stretch.
        capacity_ah: a capacity good enough to tell rest from load [Ah].
        resistance_ohm: ohmic resistance, for a record that begins under load [ohm].
    """
    current, voltage = recording.current_a, recording.voltage_v
    idle = np.abs(current[rows]) < REST_CURRENT_C * capacity_ah
    anchors: list[tuple[int, float, float]] = []
    for run in np.split(rows, np.flatnonzero(np.diff(idle)) + 1):
        measured = run[np.isfinite(voltage[run])]
        if measured.size == 0:
            continue
        first, last = int(measured[0]), int(measured[-1])
        lasted_s = recording.time_s[run[-1]] - recording.time_s[run[0]]
        if not idle[run[0] - rows[0]]:
            if run[0] == 0:
                anchors.append((first, voltage[first] + resistance_ohm * current[first], LOADED_SIGMA_V))
        elif lasted_s >= REST_S or run[0] == 0:
            anchors.append((last, voltage[last], REST_SIGMA_V))
        elif lasted_s >= SHORT_REST_S:
            anchors.append((last, voltage[last], SHORT_REST_SIGMA_V))
    at, ocv_v, sigma_v = (np.array(column) for column in zip(*anchors, strict=True)) if anchors else np.zeros((3, 0))
    return Anchors(at.astype(np.intp), ocv_v, sigma_v)


def typical_resistance(recordings: Sequence[Recording]) -> float:
    """Return the median of -dV/dI over the large steps of the current [ohm].

    Raises:
        ModelError: the current never steps, or the voltage rises with the discharge current.
    """
    ratios = []
    for r in recordings:
        step_a, step_v = np.diff(r.current_a), np.diff(r.voltage_v)
        large = (np.abs(step_a) > 0.2 * r.largest_a) & np.isfinite(step_v) & (step_a != 0.0)
        pulse_ohm = -step_v[large] / step_a[large]
        if pulse_ohm.size and float(np.median(pulse_ohm)) <= 0.0:
            raise ModelError(r.source, "the voltage rises with the discharge current; pass --charge-positive")
        ratios.append(pulse_ohm)
    steps = np.concatenate(ratios)
    if steps.size == 0:
        raise ModelError("--pulses", "the current never steps: nothing says what the resistance is")
    return float(np.median(steps))


def capacity_from_column(recordings: Sequence[Recording]) -> float | None:
    """Return the capacity [Ah] that makes charge counts and soc columns agree, None without a column that says it.

    Between a row under load and one at rest the current may have ended anywhere. Stretches in which that matters are
    left out where others say the same better; of the rest, long ones count most.
    """
    capacities_ah = []
    for recording in recordings:
        for rows in stretches(recording):
            finite_at = np.flatnonzero(np.isfinite(recording.soc[rows]))
            if finite_at.size < 2:
                continue
            between = rows[finite_at[0] : finite_at[-1] + 1]
            span = abs(float(recording.soc[between[0]] - recording.soc[between[-1]]))
            if span >= COLUMN_STEP_MIN:
                moved = abs(float(charge_ah(recording, between)[-1]))
                capacities_ah.append((moved, span, edge_charge_ah(recording, between) / span))
    moved_ah, spans, unsure_ah = np.array(capacities_ah).T if capacities_ah else np.zeros((3, 0))
    if spans.sum() < SPAN_MIN:
        return None
    error_ah = np.hypot(unsure_ah, COLUMN_ERROR_SOC / spans * (moved_ah / spans))
    best = error_ah <= UNSURE_RATIO * error_ah.min()
    return float(np.sum(moved_ah[best] * spans[best]) / np.sum(spans[best] ** 2))


def capacity_from_rests(
    recordings: Sequence[Recording], slow: SlowCurves, resistance_ohm: float
) -> tuple[float, float] | None:
    """Return the capacity by charge counted between anchors on the OCV curve and its sigma [Ah]; None without any.

    Raises:
        ModelError: a recording's count and its rest voltages cannot belong to the cell of the slow test.
    """
    moved = spanned = 0.0
    for recording in recordings:
        for rows in stretches(recording):
            anchors = find_anchors(recording, rows, slow.counted_ah, resistance_ohm)
            if anchors.rows.size < 2:
                continue
            soc, sigma = _soc_of(slow, anchors)
            span = float(soc[0] - soc[-1])
            drawn = charge_ah(recording, rows)
            counted = drawn[anchors.rows - rows[0]]
            span_sigma = float(np.hypot(sigma[0], sigma[-1]))
            drift_ah = COUNT_DRIFT_FRAC * float(np.abs(np.diff(drawn)).sum())
            sigma_ah = 3.0 * span_sigma * slow.counted_ah + drift_ah
            _check_count(recording.source, float(counted[-1] - counted[0]), span, sigma_ah, slow.counted_ah)
            if abs(span) >= SPAN_MIN:
                weight = 1.0 / span_sigma**2
                moved += float(counted[-1] - counted[0]) * span * weight
                spanned += span * span * weight
    if spanned == 0.0:
        return None
    capacity_ah = moved / spanned
    return capacity_ah, abs(capacity_ah) / float(np.sqrt(spanned))


def _check_count(source: str, counted_ah: float, span: float, unsure_ah: float, capacity_ah: float) -> None:
    expected_ah = span * capacity_ah
    if abs(counted_ah - expected_ah) > FOREIGN_FRAC * max(abs(expected_ah), abs(counted_ah)) + unsure_ah:
        raise ModelError(
            source,
            f"counts {counted_ah:.4g} Ah between rests that lie {100.0 * span:.0f} % apart on the OCV of the slow "
            f"test, which counts {capacity_ah:.4g} Ah from full to empty: another unit, clock, sign or cell?",
        )


def choose_capacity(
    slow: SlowCurves, recordings: Sequence[Recording], resistance_ohm: float, notes: list[str]
) -> float:
    """Return the capacity [Ah]: what the soc columns say, else the slow test's count unless the rests refute it."""
    column = capacity_from_column(recordings)
    if column is not None:
        if abs(column / slow.counted_ah - 1.0) > DISAGREEMENT_FRAC:
            notes.append(
                f"the slow test counts {slow.counted_ah:.4g} Ah, the soc columns say {column:.4g} Ah: those hold"
            )
        return column
    rests = capacity_from_rests(recordings, slow, resistance_ohm)
    if rests is not None and not slow.is_flat:
        capacity_ah, sigma_ah = rests
        limit = max(DISAGREEMENT_FRAC * slow.counted_ah, REFUTED_SIGMAS * sigma_ah)
        if abs(capacity_ah - slow.counted_ah) > limit and 0.5 < capacity_ah / slow.counted_ah < 2.0:
            notes.append(
                f"the slow test counts {slow.counted_ah:.4g} Ah, rests of the other tests say {capacity_ah:.4g} Ah: "
                "those hold"
            )
            return capacity_ah
    return slow.counted_ah


def has_soc_column(recording: Recording) -> bool:
    """Return whether the recording says its SOC at most of its rows."""
    return bool(np.isfinite(recording.soc).mean() > 0.5)


def reference_soc(
    recording: Recording,
    capacity_ah: float,
    slow: SlowCurves,
    resistance_ohm: float,
    notes: list[str],
    ocv_shift: OcvShift | None = None,
) -> FloatArray:
    """Return the (n,) SOC of a recording: its soc column, else the charge count laid on the anchors.

    Args:
        recording: the recording.
        capacity_ah: of the cell [Ah].
        slow: its slow curves.
        resistance_ohm: ohmic, for a recording that begins under load [ohm].
        notes: where what was assumed is added.
        ocv_shift: what the OCV at a SOC and a temperature lies above the slow curves, where that is known.

    Raises:
        ModelError: the recording has no soc column and no anchor.
    """
    is_finite = np.isfinite(recording.soc)
    if is_finite.mean() > 0.5 and not _is_coarse(recording.soc[is_finite]):
        return np.interp(np.arange(is_finite.size), np.flatnonzero(is_finite), recording.soc[is_finite])
    soc = np.full(is_finite.size, np.nan)
    unplaced = 0
    for rows in stretches(recording):
        drawn = charge_ah(recording, rows) / capacity_ah
        if is_finite[rows].any():
            start = float(np.median((recording.soc[rows] + drawn)[is_finite[rows]]))
        else:
            anchors = find_anchors(recording, rows, capacity_ah, resistance_ohm)
            if anchors.rows.size == 0:
                unplaced += rows.size
                continue
            at = drawn[anchors.rows - rows[0]]
            anchor_soc, sigma = _soc_of(slow, anchors)
            if ocv_shift is not None:
                anchor_soc, sigma = _soc_of(slow, _unshifted(anchors, anchor_soc, recording, ocv_shift))
            weight = 1.0 / (sigma**2 + (COUNT_ERROR_FRAC * (at - at[0])) ** 2)
            start = float(np.sum(weight * (anchor_soc + at)) / np.sum(weight))
        soc[rows] = start - drawn
    if unplaced == is_finite.size:
        raise ModelError(recording.source, "has no soc column and never rests: its SOC cannot be placed")
    if not is_finite.any():
        notes.append(f"{recording.source}: no soc column: SOC counted from its rests")
    if unplaced:
        notes.append(f"{recording.source}: {unplaced} rows lie between gaps and never rest: not used")
    return soc


def _soc_of(slow: SlowCurves, anchors: Anchors) -> tuple[FloatArray, FloatArray]:
    """Return the SOC of anchors on the curve that a rest after a discharge ends on, and its sigma."""
    soc = np.interp(anchors.ocv_v, slow.rested_v + 1e-9 * np.arange(slow.soc.size), slow.soc)
    slope = np.interp(soc, slow.soc, np.gradient(slow.rested_v, slow.soc))
    gap_v = np.interp(soc, slow.soc, slow.charge_v - slow.discharge_v) if slow.has_charge else UNSEEN_GAP_V
    return soc, np.hypot(anchors.sigma_v, 0.25 * gap_v) / np.maximum(slope, SLOPE_MIN_V)


def _unshifted(anchors: Anchors, soc: FloatArray, recording: Recording, ocv_shift: OcvShift) -> Anchors:
    """Return the anchors with the OCV they would show at the temperature of the slow curves."""
    degc = recording.temperature_degc[anchors.rows]
    return replace(anchors, ocv_v=anchors.ocv_v - ocv_shift(soc, degc))


def _is_coarse(soc: FloatArray) -> bool:
    steps = np.abs(np.diff(soc))
    steps = steps[steps > 0.0]
    return bool(steps.size) and float(np.median(steps)) > COARSE_SOC
