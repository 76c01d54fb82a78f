"""Turns columns as users have them into one clean recording of a cell, and says what was done.

Arrays come in by name; files are read elsewhere. Nothing is guessed in silence: every repair is a note, and what
cannot be repaired is a `DatasetError` that names the column and the way out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

REQUIRED = ("current_a", "voltage_v")
FIELDS = ("time_s", "current_a", "voltage_v", "temperature_degc", "soc")
LATE_ROWS = 5  # a stamp this many rows late is a row out of place; more is a clock that started again
BACKWARD_LIMIT_FRAC = 0.05  # more backward steps than this and the column is not a time
GAP_STEPS = 10.0  # a step this many times the usual one is a gap
CURRENT_MAX_C = 60.0  # a usual current above it is no cell's
CELL_VOLTAGE_MIN_V = 0.5  # no cell is below it for half of a recording
CELL_VOLTAGE_LIMIT_V = 10.0  # above this the column cannot be the volts of one cell


class DatasetError(ValueError):
    """A recording cannot be used; the message names the source, the column and what to do."""

    def __init__(self, source: str, problem: str) -> None:
        self.source = source
        self.problem = problem
        super().__init__(f"{source}: {problem}")


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
        return _usual_step(self.time_s)

    @property
    def charge_ah(self) -> FloatArray:
        """(n,) charge drawn since the first row [Ah], trapezoidal, over gaps as well."""
        mean_a = 0.5 * (self.current_a[1:] + self.current_a[:-1])
        return np.concatenate(([0.0], np.cumsum(mean_a * np.diff(self.time_s)) / 3600.0))


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
        columns: (n,) arrays by name out of `FIELDS`; NaN where a value is missing.
        charge_positive: the source counts charging current as positive.
        period_s: time between rows [s] for a source without a time column, > 0.

    Returns:
        The recording; `notes` lists every repair and every doubt, in plain words.

    Raises:
        DatasetError: a column is missing, empty, has another length, or cannot be what it is said to be.
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

    table = _in_time_order(source, table, notes)
    table = _without_repeats(source, table, notes)
    if charge_positive:
        table[:, 1] = -table[:, 1]
        notes.append("current was positive on charge: sign turned")
    _scale_to_units(source, table, notes)
    _note_gaps(table, notes)
    missing = int(np.isnan(table[:, 2]).sum())
    if missing:
        notes.append(f"{missing} rows have no voltage: kept as missing")
    doubt = _sign_doubt(table[:, 1], table[:, 2])
    if doubt:
        notes.append(doubt)
    time_s, current_a, voltage_v, temperature_degc, soc = (np.ascontiguousarray(c) for c in table.T)
    return Recording(source, time_s, current_a, voltage_v, _held(temperature_degc), soc, tuple(notes))


def check_currents(recording: Recording, capacity_ah: float) -> None:
    """Refuse a recording whose currents no cell of this capacity can give: they are in another unit.

    Raises:
        DatasetError: the median of the currents that flow is beyond `CURRENT_MAX_C`.
    """
    flowing = np.abs(recording.current_a[recording.current_a != 0.0])
    usual_a = float(np.median(flowing)) if flowing.size else 0.0
    if usual_a > CURRENT_MAX_C * capacity_ah:
        problem = f"current_a is usually {usual_a:.4g} A, {usual_a / capacity_ah:.3g} times the capacity of the cell"
        raise DatasetError(recording.source, f"{problem}: if it is in mA, pass --map current_a=COLUMN*0.001")


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


def _usual_step(time_s: FloatArray) -> float:
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if steps.size else 1.0


def _in_time_order(source: str, table: FloatArray, notes: list[str]) -> FloatArray:
    """Return the rows in time order: reversed files, rows out of place and clocks that start again are put right."""
    steps = np.diff(table[:, 0])
    back = int((steps < 0.0).sum())
    if back == 0:
        return table
    if back >= 0.9 * np.count_nonzero(steps):
        notes.append("the newest row came first: order reversed")
        table = table[::-1].copy()
        steps = np.diff(table[:, 0])
        back = int((steps < 0.0).sum())
    if back > max(BACKWARD_LIMIT_FRAC * len(table), 1):
        raise DatasetError(
            source, f"time runs backwards {back} times in {len(table)} rows: is time_s the right column?"
        )
    restarts = 0
    usual = _usual_step(table[:, 0])
    for k in np.flatnonzero(steps < 0.0):
        ahead = table[k + 1 : k + 2 + LATE_ROWS, 0]
        if ahead.size > LATE_ROWS and ahead.max() < table[k, 0]:
            table[k + 1 :, 0] += table[k, 0] - table[k + 1, 0] + usual
            restarts += 1
    if restarts:
        notes.append(f"the clock started again {restarts} times: parts joined {usual:g} s apart")
    order = np.argsort(table[:, 0], kind="stable")
    moved = int(np.count_nonzero(np.diff(table[:, 0]) < 0.0))
    if moved:
        notes.append(f"time ran backwards {moved} times: rows sorted")
    return table[order]


def _without_repeats(source: str, table: FloatArray, notes: list[str]) -> FloatArray:
    """Return the rows without exact repeats; a coarse clock is spread evenly, a step may keep its two rows."""
    same = np.flatnonzero(np.diff(table[:, 0]) == 0.0)
    if same.size == 0:
        return table
    if same.size > 0.5 * len(table):
        stamps, first, count = np.unique(table[:, 0], return_index=True, return_counts=True)
        if stamps.size == 1:
            raise DatasetError(source, "time_s is the same in every row: give --period SECONDS between rows instead")
        usual = float(np.median(np.diff(stamps))) if stamps.size > 1 else 1.0
        width = np.append(np.minimum(np.diff(stamps), usual), usual)
        place = np.arange(len(table)) - np.repeat(first, count)
        table = table.copy()
        table[:, 0] += place * np.repeat(width / count, count)
        notes.append(f"the clock counts in steps of {usual:g} s: rows within a step spread evenly")
        return table
    repeat = np.zeros(len(table), dtype=bool)
    repeat[same + 1] = np.all((table[same, 1:3] == table[same + 1, 1:3]) | np.isnan(table[same + 1, 1:3]), axis=1)
    inner = np.zeros(len(table), dtype=bool)
    inner[same[1:][np.diff(same) == 1]] = True
    drop = repeat | inner
    kept = same.size - int(drop.sum())
    if drop.any():
        notes.append(f"{int(drop.sum())} rows with the stamp of another left out")
    if kept > 0:
        notes.append(f"{kept} stamps occur twice with different values: kept as before and after a step")
    return table[~drop]


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


def _note_gaps(table: FloatArray, notes: list[str]) -> None:
    steps = np.diff(table[:, 0])
    gaps = steps[steps > GAP_STEPS * _usual_step(table[:, 0])]
    if gaps.size:
        notes.append(f"{gaps.size} gaps, the longest {gaps.max():.6g} s")


def _sign_doubt(current_a: FloatArray, voltage_v: FloatArray) -> str | None:
    """Return a warning when the voltage rises with the discharge current over the large steps of the current."""
    step_a, step_v = np.diff(current_a), np.diff(voltage_v)
    large = (np.abs(step_a) > 0.2 * max(float(np.abs(current_a).max()), 1e-12)) & np.isfinite(step_v)
    if not large.any() or float(np.sum(step_a[large] * step_v[large])) <= 0.0:
        return None
    return "warning: the voltage rises with the discharge current; if charging is positive, pass --charge-positive"


def _held(values: FloatArray) -> FloatArray:
    """Return the values with gaps filled by the last one before, and at the start by the first."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size in (0, len(values)):
        return values
    before = np.searchsorted(known, np.arange(len(values)), side="right") - 1
    return values[known[np.maximum(before, 0)]]
