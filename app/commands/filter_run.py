"""Runs a filter for one cell along a recording: its start, its gaps, and where the recording leaves what it knows."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.filters.estimates import (
    N_OUT,
    OUT_INNOVATION,
    OUT_INNOVATION_SIGMA,
    OUT_SIGMA,
    OUT_SOC,
    OUT_VALID,
    OUT_VOLTAGE,
)
from app.estimation.filters.first_minutes import KEPT_S, FirstMinutes
from app.estimation.filters.soc_estimator import SocEstimator
from app.estimation.filters.tuning import Tuning
from app.estimation.health.learned import LEARN_S, RESISTANCE_SIGMA_MAX, LearningRun
from app.estimation.health.sensor_offset import COMPARE_S, OffsetTracker, SensorOffset
from app.estimation.identification.branches import GAP_S
from app.estimation.recording.cell_recording import GAP_STEPS, Recording
from app.estimation.recording.gaps import SHORT_GAP_S, Around, Gap, bridge_gap

DEFAULT_TEMPERATURE_DEGC = 25.0  # assumed temperature of a recording without one
UNKNOWN_SOC = 0.5  # sigma of a SOC of which nothing is known
TEMPERATURE_ERROR_NOTED = 0.1  # by which resistances may be off for want of measurements before a note says so
BEYOND_FIT = 1.1  # times the largest current of the fit: above, the model has no evidence


@dataclass(frozen=True)
class Run:
    """Estimates along a recording, every array (n,); `innovation_v` is measured minus predicted [V].

    Capacity [Ah] and resistance over that of the cell file are those learned at the end.
    """

    soc: FloatArray
    soc_sigma: FloatArray
    voltage_v: FloatArray
    innovation_v: FloatArray
    innovation_sigma_v: FloatArray
    model_valid_frac: float
    us_per_step: float
    sensor: SensorOffset | None
    capacity_ah: float
    capacity_sigma_ah: float
    resistance_factor: float
    resistance_sigma: float


def run_filter(
    estimator: SocEstimator,
    recording: Recording,
    capacity_ah: float,
    initial_soc: float | None = None,
    initial_sigma: float | None = None,
    cell: CellModel | None = None,
    on_progress: Callable[[int, int], None] = lambda done, of: None,
) -> Run:
    """Return what a one-cell estimator says at every row of a recording.

    Args:
        estimator: a filter for one cell; it is started at the first row.
        recording: the measurements.
        capacity_ah: of the cell [Ah].
        initial_soc: SOC assumed at the first row, 0..1; None = from the voltage there.
        initial_sigma: standard deviation of that; None = the filter's default.
        cell: its model; resistances are learned only near temperatures it was made at. None = at all.
        on_progress: called with how many rows are done, of how many.

    Raises:
        EstimatorError: the filter refuses the numbers.
    """
    temperature = np.where(np.isnan(recording.temperature_degc), DEFAULT_TEMPERATURE_DEGC, recording.temperature_degc)
    voltages, temperatures = recording.voltage_v[:, None], temperature[:, None]
    current, steps = recording.current_a, recording.step_s
    first = _first_measured(recording)

    def restart() -> SocEstimator:
        estimator.start(voltages[first], temperatures[first], float(current[first]), initial_soc, initial_sigma)
        return estimator

    restart()
    first_minutes = FirstMinutes()
    is_due = False
    is_measured = np.full(len(steps), True) if cell is None else cell.drop_error(temperature) < Tuning().drop_error_max
    learnt_from = np.where(is_measured[:, None], voltages, np.nan)
    offset = None if estimator.voltage_soc() is None else OffsetTracker(capacity_ah)
    begun = time.perf_counter()
    gaps = gaps_of(recording, capacity_ah)
    received = steps.copy()  # a gap counts as one usual step: the rest is bridged
    received[list(gaps)] = recording.usual_step_s
    time_s, drawn_as = (
        np.concatenate(([0.0], np.cumsum(step))) for step in (received, received * np.nan_to_num(current))
    )
    unheard, learning, table = np.full(1, np.nan), LearningRun(estimator), np.empty((N_OUT, len(steps)))
    samples = received, steps, current, voltages, learnt_from, temperatures
    for rows in _pieces(steps, gaps):
        if (gap := gaps.get(rows.start)) is not None:
            estimator.step(steps[rows.start] - received[rows.start], gap.current_a, unheard, temperatures[rows.start])
            estimator.widen(min(gap.sigma_ah / capacity_ah, UNKNOWN_SOC))
            first_minutes.drop()
            if offset is not None:
                offset.interrupt()
        for k in range(rows.start, rows.stop) if first_minutes.is_keeping else ():
            first_minutes.keep(float(received[k]), float(current[k]), voltages[k], temperatures[k])
        table[:, rows] = learning.step([sample[rows] for sample in samples]).numbers[:, :, 0]
        if first_minutes.is_keeping:
            first_minutes.again(learning.factor, learning.judge()[1] <= RESISTANCE_SIGMA_MAX, restart)
        if offset is not None:
            lasted_s, charge_as = (float(sums[rows.stop] - sums[rows.start]) for sums in (time_s, drawn_as))
            is_due |= offset.step(lasted_s, charge_as / lasted_s if lasted_s > 0.0 else 0.0)
        on_progress(rows.stop, len(steps))
        # a model that is not valid says nothing of the sensor
        is_valid = table[OUT_VALID, rows.stop - 1] > 0.0
        if is_due and offset is not None and is_valid and (voltage_soc := estimator.voltage_soc()) is not None:
            is_due = False
            offset.compare(*voltage_soc)
    took_s = time.perf_counter() - begun
    sensor = None if offset is None else offset.estimate()
    own_ah, own_sigma_ah = estimator.capacity()
    learned, learned_sigma = learning.judge()
    return Run(
        table[OUT_SOC],
        table[OUT_SIGMA],
        table[OUT_VOLTAGE],
        table[OUT_INNOVATION],
        table[OUT_INNOVATION_SIGMA],
        float(np.mean(table[OUT_VALID])),
        1e6 * took_s / len(steps),
        sensor,
        float(own_ah[0]),
        float(own_sigma_ah[0]),
        float(learned[0]),
        float(learned_sigma[0]),
    )


def _pieces(step_s: FloatArray, gaps: Container[int]) -> Iterator[slice]:
    """Yield rows of a second, after the first minutes of COMPARE_S; a gap begins new ones."""
    begin, since_s, time_s = 0, 0.0, 0.0
    for k, dt_s in enumerate(step_s.tolist()):
        if k in gaps and k > begin:
            yield slice(begin, k)
            begin = k
        since_s, time_s = since_s + dt_s, time_s + dt_s
        if since_s >= (LEARN_S if time_s <= KEPT_S else COMPARE_S):
            yield slice(begin, k + 1)
            begin, since_s = k + 1, 0.0
    if begin < len(step_s):
        yield slice(begin, len(step_s))


def _first_measured(recording: Recording) -> int:
    """Return the first row with a voltage; row 0 where none comes before long."""
    soon = np.isfinite(recording.voltage_v) & (recording.time_s - recording.time_s[0] <= GAP_S)
    return int(np.argmax(soon))


def outside_notes(recording: Recording, cell: CellModel) -> list[str]:
    """Say where the recording leaves what the cell file knows."""
    notes = []
    temperature = recording.temperature_degc
    finite = temperature[np.isfinite(temperature)]
    if finite.size == 0:
        notes.append(f"no temperature: {DEFAULT_TEMPERATURE_DEGC:g} degC taken")
    elif float(error := cell.drop_error(finite[[finite.argmin(), finite.argmax()]]).max()) > TEMPERATURE_ERROR_NOTED:
        seen = cell.measured_degc
        notes.append(
            f"warning: {finite.min():.0f} to {finite.max():.0f} degC, the cell was measured from {seen[0]:.0f} to "
            f"{seen[-1]:.0f} degC: resistances may be off by {100.0 * error:.0f} %"
        )
    largest_a = float(np.abs(recording.current_a).max())
    if cell.fit_current_max_a and largest_a > BEYOND_FIT * cell.fit_current_max_a:
        notes.append(
            f"warning: up to {largest_a:.3g} A, the cell file is fitted to {cell.fit_current_max_a:.3g} A at most"
        )
    return notes


def gaps_of(recording: Recording, capacity_ah: float) -> dict[int, Gap]:
    """Return the gaps by the row behind them: steps of more than GAP_STEPS usual ones."""
    current, steps = recording.current_a, recording.step_s
    usual_a = float(np.sqrt(np.mean(current**2)))
    minute = ((recording.time_s - recording.time_s[0]) // SHORT_GAP_S).astype(np.intp)
    n_rows = np.bincount(minute)
    slow_a = float(np.std((np.bincount(minute, current) / np.maximum(n_rows, 1))[n_rows > 0]))
    gaps = {}
    for k in np.flatnonzero(steps > GAP_STEPS * recording.usual_step_s).tolist():
        around = np.abs(recording.time_s - recording.time_s[k]) < SHORT_GAP_S / 2.0
        ends_a = float(current[k - 1]), float(current[k])
        mean_a, spread_a = float(np.mean(current[around])), float(np.std(current[around]))
        gaps[k] = bridge_gap(float(steps[k]), ends_a, Around(mean_a, spread_a, slow_a, usual_a), capacity_ah)
    return gaps


def gap_notes(recording: Recording, capacity_ah: float) -> list[str]:
    """Say what was assumed of gaps."""
    steps = recording.step_s
    moved_ah = [
        (gap.current_a * float(steps[k]) / SECONDS_PER_HOUR, min(gap.sigma_ah, UNKNOWN_SOC * capacity_ah))
        for k, gap in gaps_of(recording, capacity_ah).items()
    ]
    charge_ah, sigma_ah = sum(charge for charge, _ in moved_ah), math.hypot(*(sigma for _, sigma in moved_ah))
    if max(abs(charge_ah), sigma_ah) < 1e-3:
        return []
    return [f"in gaps {charge_ah:+.3g} Ah, sigma {sigma_ah:.2g} Ah, are taken to have flowed that were not measured"]
