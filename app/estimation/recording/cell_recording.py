"""Turns columns as users have them into one clean recording of a cell, and says what was done.

Arrays come in by name; files are read elsewhere. Nothing is guessed in silence: every repair is a note, and what
cannot be repaired is a `DatasetError` that names the column and the way out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.errors import DatasetError
from app.estimation.recording.time_axis import usual_step, without_repeats

REQUIRED = ("current_a", "voltage_v")
FIELDS = ("time_s", "current_a", "voltage_v", "temperature_degc", "soc")
GAP_STEPS = 10.0  # a step this many times the usual one is a gap
CURRENT_MAX_C = 60.0  # a usual current above it is no cell's
CELL_VOLTAGE_MIN_V = 0.5  # no cell is below it for half of a recording
CELL_VOLTAGE_LIMIT_V = 10.0  # above this the column cannot be the volts of one cell
TEMPERATURE_RANGE_DEGC = (-60.0, 150.0)  # outside, a sensor is broken or not there
HOT_DEGC = 65.0  # a cell that is usually warmer is rather written in Fahrenheit
SPIKE_RATIO = 20.0  # times the third largest current: one row or two beyond are no current
SPIKE_EVIDENCE = 0.01  # share of the rows under a like current that it takes to call those two a spike
SHORT_STEP_S = 0.005  # rows that lie closer are rather minutes or hours taken for seconds
SWING_UNCERTAINTY = (
    1.3  # share of the capacity: more charge between the highest and lowest point of a run is a wrong count ...
)
SWING_MAX = 5.0  # ... and so much more another unit, clock or cell
SOC_MAX = 1.05


@dataclass(frozen=True)
class Recording:
    """One test or drive of one cell, in time order.

    Every array has shape (n,). Current is positive on discharge. NaN in `voltage_v`, `temperature_degc` and `soc` means
    not measured; `time_s` [s] never falls and `current_a` [A] is always finite.
    """

    source: str
    time_s: FloatArray
    current_a: FloatArray
    voltage_v: FloatArray
    temperature_degc: FloatArray
    soc: FloatArray
    notes: tuple[str, ...]

    @property
    def step_s(self) -> FloatArray:
        """(n,) time since the row before [s], 0 for the first."""
        return np.diff(self.time_s, prepend=self.time_s[:1])

    @property
    def usual_step_s(self) -> float:
        """The median of the steps that are not zero [s], 1 where there is none."""
        return usual_step(self.time_s)

    @property
    def largest_a(self) -> float:
        """The third largest magnitude of the current [A]: one row or two may be a spike."""
        return _third_largest(self.current_a)

    @property
    def charge_ah(self) -> FloatArray:
        """(n,) charge drawn since the first row [Ah], trapezoidal, over gaps as well."""
        mean_a = 0.5 * (self.current_a[1:] + self.current_a[:-1])
        return np.concatenate(([0.0], np.cumsum(mean_a * np.diff(self.time_s)) / 3600.0))

    @property
    def seen_charge_ah(self) -> FloatArray:
        """(n,) charge drawn since the first row [Ah], trapezoidal, with nothing counted over gaps."""
        mean_a = 0.5 * (self.current_a[1:] + self.current_a[:-1])
        steps = np.diff(self.time_s)
        steps = np.where(steps > GAP_STEPS * self.usual_step_s, 0.0, steps)
        return np.concatenate(([0.0], np.cumsum(mean_a * steps) / 3600.0))


def clean(
    source: str,
    columns: Mapping[str, FloatArray],
    *,
    charge_positive: bool = False,
    period_s: float | None = None,
) -> Recording:
    """Return the recording that the columns describe, repaired where that is safe.

    Args:
        source: name of the file, for notes and errors.
        columns: (n,) arrays by name out of `FIELDS`, in order of time; NaN where a value is missing.
        charge_positive: the source counts charging current as positive.
        period_s: time between rows [s] for a source without a time column, > 0.

    Returns:
        The recording; `notes` lists every repair and every warning, in plain words.

    Raises:
        DatasetError: a column is missing, empty, has another length, or cannot be what it claims.
    """
    notes: list[str] = []
    columns = dict(columns)
    _check_columns(source, columns, period_s)
    n = len(columns["current_a"])
    if "time_s" not in columns and period_s is not None:
        columns["time_s"] = np.arange(n, dtype=np.float64) * float(period_s)
        notes.append(f"no time column: rows taken {period_s:g} s apart")
    table = np.column_stack([columns.get(name, np.full(n, np.nan)) for name in FIELDS])
    table = np.array(table, dtype=np.float64)
    table[~np.isfinite(table)] = np.nan

    for column, name in ((0, "time_s"), (1, "current_a")):
        keep = np.isfinite(table[:, column])
        if not keep.all():
            notes.append(f"{int((~keep).sum())} rows without {name} left out")
            table = table[keep]
    if len(table) < 2:
        raise DatasetError(source, "fewer than two rows have both a time and a current")
    if not np.isfinite(table[:, 2]).any():
        raise DatasetError(source, "voltage_v holds no number")

    table = without_repeats(source, table, notes)
    if charge_positive:
        table[:, 1] = -table[:, 1]
        notes.append("current was positive on charge: sign turned")
    _scale_to_units(source, table, notes)
    missing = int(np.isnan(table[:, 2]).sum())
    if missing:
        notes.append(f"{missing} rows have no voltage: kept as missing")
    _drop_impossible(table, notes)
    table = _without_spikes(table, notes)
    _note_gaps(table, notes)
    notes += _warnings(table)
    time_s, current_a, voltage_v, temperature_degc, soc = (np.ascontiguousarray(c) for c in table.T)
    return Recording(source, time_s, current_a, voltage_v, _held(temperature_degc), soc, tuple(notes))


def believable(recording: Recording, capacity_ah: float) -> Recording:
    """Return the recording without the rows whose current no cell of this capacity can give.

    Raises:
        DatasetError: the usual current, or the charge that moved, is beyond such a cell: another unit or clock.
    """
    limit_a = CURRENT_MAX_C * capacity_ah
    size_a = np.abs(recording.current_a)
    usual_a = float(np.median(size_a[size_a > 0.0])) if size_a.any() else 0.0
    if usual_a > limit_a:
        problem = f"current_a is usually {usual_a:.4g} A, {usual_a / capacity_ah:.3g} times the capacity of the cell"
        raise DatasetError(recording.source, f"{problem}: if it is in mA, pass --map current_a=COLUMN*0.001")
    keep = size_a <= limit_a
    if not keep.all():
        arrays = {name: getattr(recording, name)[keep] for name in FIELDS}
        note = f"{int((~keep).sum())} rows with a current beyond {limit_a:.4g} A left out"
        recording = replace(recording, **arrays, notes=(*recording.notes, note))
    moved_ah = float(np.ptp(recording.seen_charge_ah))
    problem = f"{moved_ah:.4g} Ah flow one way, the cell holds {capacity_ah:.4g} Ah"
    question = "is time_s in seconds, current_a in amperes, and is it this cell?"
    if moved_ah > SWING_MAX * capacity_ah:
        raise DatasetError(recording.source, f"{problem}: {question}")
    if moved_ah > SWING_UNCERTAINTY * capacity_ah:
        recording = replace(recording, notes=(*recording.notes, f"warning: {problem}: {question}"))
    return recording


def _check_columns(source: str, columns: Mapping[str, FloatArray], period_s: float | None) -> None:
    for name in columns:
        if name not in FIELDS:
            raise DatasetError(source, f"unknown column {name}; known are {', '.join(FIELDS)}")
    for name in REQUIRED:
        if name not in columns:
            raise DatasetError(source, f"no column for {name}; name it with --map {name}=COLUMN")
    if "time_s" not in columns and period_s is None:
        raise DatasetError(source, "no time column; name it with --map time_s=COLUMN or give --period SECONDS")
    if period_s is not None and not period_s > 0.0:
        raise DatasetError(source, f"the period between rows must be above 0 s, not {period_s}")
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DatasetError(source, f"columns of different length: {lengths}")


def _scale_to_units(source: str, table: FloatArray, notes: list[str]) -> None:
    voltage = float(np.nanmedian(np.abs(table[:, 2])))
    if 1000.0 < voltage < 1000.0 * CELL_VOLTAGE_LIMIT_V:
        table[:, 2] *= 1e-3
        notes.append("voltage looks like millivolts: divided by 1000")
    elif not CELL_VOLTAGE_MIN_V < voltage < CELL_VOLTAGE_LIMIT_V:
        raise DatasetError(source, f"voltage_v is about {voltage:.4g}: not the volts of one cell")
    temperature = table[:, 3]
    if np.isfinite(temperature).any() and float(np.nanmedian(temperature)) > 200.0:
        temperature -= 273.15
        notes.append("temperature looks like kelvin: 273.15 taken off")
    soc = table[:, 4]
    if np.isfinite(soc).any() and float(np.nanmax(soc)) > 1.5:
        soc /= 100.0
        notes.append("soc looks like percent: divided by 100")
    if np.isfinite(soc).any() and float(np.nanmax(soc)) > SOC_MAX:
        notes.append(f"warning: soc goes up to {np.nanmax(soc):.4g}: 1 is full")


def _drop_impossible(table: FloatArray, notes: list[str]) -> None:
    """Set to missing what a broken channel wrote: volts no cell has, temperatures no cell lives at."""
    for column, name, (low, high) in (
        (2, "voltage_v", (CELL_VOLTAGE_MIN_V, CELL_VOLTAGE_LIMIT_V)),
        (3, "temperature", TEMPERATURE_RANGE_DEGC),
    ):
        values = table[:, column]
        impossible = (values < low) | (values > high)
        if impossible.any():
            values[impossible] = np.nan
            notes.append(f"{int(impossible.sum())} rows have a {name} outside {low:g} to {high:g}: taken as missing")
    temperature = table[:, 3]
    if np.isfinite(temperature).any() and float(np.nanmedian(temperature)) > HOT_DEGC:
        notes.append(f"warning: temperature is usually {np.nanmedian(temperature):.0f} degC: is it in Fahrenheit?")


def _without_spikes(table: FloatArray, notes: list[str]) -> FloatArray:
    """Return the rows without the one or two whose current is far beyond that of all others."""
    size_a = np.abs(table[:, 1])
    usual_a = _third_largest(size_a)
    if usual_a == 0.0 or float(np.mean(size_a > 0.5 * usual_a)) < SPIKE_EVIDENCE:
        return table
    spike = size_a > SPIKE_RATIO * usual_a
    if spike.any():
        notes.append(f"{int(spike.sum())} rows with a current of up to {size_a.max():.4g} A, a spike, left out")
    return table[~spike]


def _warnings(table: FloatArray) -> list[str]:
    """Return warnings about what was read but can hardly be meant."""
    warnings = []
    if not table[:, 1].any():
        warnings.append("warning: the current is zero in every row")
    step_s = usual_step(table[:, 0])
    if step_s < SHORT_STEP_S:
        warnings.append(
            f"warning: rows lie {1e3 * step_s:.3g} ms apart; if time is in minutes, pass --map time_s=COLUMN*60"
        )
    warning = _sign_warning(table[:, 1], table[:, 2])
    return [*warnings, warning] if warning else warnings


def _note_gaps(table: FloatArray, notes: list[str]) -> None:
    steps = np.diff(table[:, 0])
    gaps = steps[steps > GAP_STEPS * usual_step(table[:, 0])]
    if gaps.size:
        notes.append(f"gaps: {gaps.size}, the longest {gaps.max():.6g} s")


def _sign_warning(current_a: FloatArray, voltage_v: FloatArray) -> str | None:
    """Return a warning when the voltage rises with the discharge current over the large steps of the current."""
    step_a, step_v = np.diff(current_a), np.diff(voltage_v)
    large = (np.abs(step_a) > 0.2 * max(_third_largest(current_a), 1e-12)) & np.isfinite(step_v)
    if not large.any() or float(np.median(step_v[large] / step_a[large])) <= 0.0:
        return None
    return "warning: the voltage rises with the discharge current; if charging is positive, pass --charge-positive"


def _third_largest(current_a: FloatArray) -> float:
    rank = min(3, current_a.size)
    return float(np.partition(np.abs(current_a), -rank)[-rank])


def _held(values: FloatArray) -> FloatArray:
    """Return the values with gaps filled by the last one before, and at the start by the first."""
    finite_at = np.flatnonzero(np.isfinite(values))
    if finite_at.size in (0, len(values)):
        return values
    before = np.searchsorted(finite_at, np.arange(len(values)), side="right") - 1
    return values[finite_at[np.maximum(before, 0)]]
