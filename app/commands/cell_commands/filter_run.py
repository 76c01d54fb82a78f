"""Runs a filter for one cell along a recording: its start, its gaps, and where the recording leaves what it knows."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.filters.estimators import CellEstimator
from app.estimation.health.sensor_offset import OffsetTracker, SensorOffset
from app.estimation.identification.branches import GAP_S
from app.estimation.recording.cell_recording import GAP_STEPS, Recording

DEFAULT_TEMPERATURE_DEGC = 25.0  # of a recording that has no temperature
BEYOND_FIT = 1.1  # times the largest current of the fit: above, the model has no evidence


@dataclass(frozen=True)
class Run:
    """What a filter said along a recording, every array (n,); `innovation_v` is measured minus predicted [V]."""

    soc: FloatArray
    soc_sigma: FloatArray
    voltage_v: FloatArray
    innovation_v: FloatArray
    innovation_sigma_v: FloatArray
    model_valid_frac: float
    us_per_step: float
    sensor: SensorOffset | None


def run_filter(
    estimator: CellEstimator,
    recording: Recording,
    capacity_ah: float,
    initial_soc: float | None = None,
    initial_sigma: float | None = None,
) -> Run:
    """Return what a one-cell estimator says at every row of a recording.

    Args:
        estimator: a filter for one cell; it is started at the first row.
        recording: the measurements.
        capacity_ah: of the cell [Ah].
        initial_soc: SOC believed at the first row, 0..1; None = from the voltage there.
        initial_sigma: standard deviation of that; None = the filter's default.

    Raises:
        EstimatorError: the filter refuses the numbers.
    """
    temperature = np.where(np.isnan(recording.temperature_degc), DEFAULT_TEMPERATURE_DEGC, recording.temperature_degc)
    voltages, temperatures = recording.voltage_v[:, None], temperature[:, None]
    current, steps = recording.current_a.tolist(), recording.step_s.tolist()
    first = _first_measured(recording)
    estimator.start(voltages[first], temperatures[first], current[first], initial_soc, initial_sigma)
    table = np.empty((5, len(steps)))
    valid = 0
    offset = None if estimator.voltage_soc() is None else OffsetTracker(capacity_ah)
    begun = time.perf_counter()
    in_gap = _in_gap(recording).tolist()
    unheard = np.full(1, np.nan)
    for k, (dt_s, current_a) in enumerate(zip(steps, current, strict=True)):
        if in_gap[k]:
            gap_a = _gap_current_a(current[k - 1], current_a, dt_s, capacity_ah)
            dt_s = recording.usual_step_s
            estimator.step(steps[k] - dt_s, gap_a, unheard, temperatures[k])
            if offset is not None:
                offset.interrupt()
        e = estimator.step(dt_s, current_a, voltages[k], temperatures[k])
        table[0, k], table[1, k], table[2, k] = e.soc[0], e.soc_sigma[0], e.voltage_v[0]
        table[3, k], table[4, k] = e.innovation_v[0], e.innovation_sigma_v[0]
        valid += bool(e.model_valid[0])
        if offset is not None and offset.step(dt_s, current_a) and (voltage_soc := estimator.voltage_soc()) is not None:
            offset.compare(*voltage_soc)
    took_s = time.perf_counter() - begun
    soc, sigma, voltage, innovation, innovation_sigma = table
    sensor = None if offset is None else offset.estimate()
    return Run(soc, sigma, voltage, innovation, innovation_sigma, valid / len(steps), 1e6 * took_s / len(steps), sensor)


def _first_measured(recording: Recording) -> int:
    """Return the first row with a voltage; row 0 where none comes before long."""
    soon = np.isfinite(recording.voltage_v) & (recording.time_s - recording.time_s[0] <= GAP_S)
    return int(np.argmax(soon))


def outside_notes(recording: Recording, cell: CellModel) -> list[str]:
    """Say where the recording leaves what the cell file knows."""
    notes = []
    temperature, grid = recording.temperature_degc, cell.temperature_grid_degc
    if np.isnan(temperature).all():
        notes.append(f"no temperature: {DEFAULT_TEMPERATURE_DEGC:g} degC taken")
    elif grid.size > 1 and (temperature.min() < grid[0] or temperature.max() > grid[-1]):
        reach = f"{temperature.min():.0f} to {temperature.max():.0f} degC"
        notes.append(f"warning: {reach}, the tables of the cell reach from {grid[0]:.0f} to {grid[-1]:.0f} degC")
    largest_a = float(np.abs(recording.current_a).max())
    if cell.fit_current_max_a and largest_a > BEYOND_FIT * cell.fit_current_max_a:
        notes.append(
            f"warning: up to {largest_a:.3g} A, the cell file is fitted to {cell.fit_current_max_a:.3g} A at most"
        )
    return notes


def _in_gap(recording: Recording) -> NDArray[np.bool_]:
    """Return (n,) True for rows before which nothing was measured for long."""
    return np.asarray(recording.step_s > max(GAP_S, GAP_STEPS * recording.usual_step_s))


def _gap_current_a(before_a: float, after_a: float, gap_s: float, capacity_ah: float) -> float:
    """Return the current taken to have flowed in a gap [A]: the smaller one at its ends.

    None, where they differ in sign or would have moved half of the capacity: then nothing is known of it.
    """
    smaller_a = min(before_a, after_a, key=abs) if before_a * after_a > 0.0 else 0.0
    return smaller_a if abs(smaller_a) * gap_s < 0.5 * 3600.0 * capacity_ah else 0.0


def gap_notes(recording: Recording, capacity_ah: float) -> list[str]:
    """Say what was assumed of gaps."""
    current, steps = recording.current_a.tolist(), recording.step_s
    after = np.flatnonzero(_in_gap(recording)).tolist()
    charge_ah = 0.0
    for k in after:
        gap_s = float(steps[k])
        charge_ah += _gap_current_a(current[k - 1], current[k], gap_s, capacity_ah) * gap_s / 3600.0
    if abs(charge_ah) < 1e-3:
        return []
    return [f"in gaps the smaller current of their two ends counts: {charge_ah:+.3g} Ah that were not measured"]
