"""Puts the rows of a recording in time order and gives every row a stamp of its own, saying what was done."""

from __future__ import annotations

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.errors import DatasetError

LATE_ROWS = 5  # a stamp this many rows late is a row out of place; more is a clock that started again
BACKWARD_LIMIT_FRAC = 0.05  # more backward steps than this and the column is not a time


def usual_step(time_s: FloatArray) -> float:
    """Return the median of the steps of (n,) stamps that are not zero [s], 1 where there is none."""
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if steps.size else 1.0


def in_time_order(source: str, table: FloatArray, notes: list[str]) -> FloatArray:
    """Return the rows in time order: reversed files, rows out of place and clocks that start again are put right.

    Args:
        source: name of the file, for the error.
        table: (n, columns) rows with time_s [s] in the first column.
        notes: gets what was done.

    Raises:
        DatasetError: time runs backwards too often to be a time.
    """
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
        raise DatasetError(source, f"time runs backwards ({back} x) in {len(table)} rows: is time_s the right column?")
    restarts = 0
    usual = usual_step(table[:, 0])
    for k in np.flatnonzero(steps < 0.0):
        ahead = table[k + 1 : k + 2 + LATE_ROWS, 0]
        if ahead.size > LATE_ROWS and ahead.max() < table[k, 0]:
            table[k + 1 :, 0] += table[k, 0] - table[k + 1, 0] + usual
            restarts += 1
    if restarts:
        notes.append(f"the clock started again ({restarts} x): parts joined {usual:g} s apart")
    order = np.argsort(table[:, 0], kind="stable")
    moved = int(np.count_nonzero(np.diff(table[:, 0]) < 0.0))
    if moved:
        notes.append(f"time ran backwards ({moved} x): rows sorted")
    return table[order]


def without_repeats(source: str, table: FloatArray, notes: list[str]) -> FloatArray:
    """Return the rows without exact repeats; a coarse clock is spread evenly, a step may keep its two rows.

    Args:
        source: name of the file, for the error.
        table: (n, columns) rows in time order: time_s, current_a, voltage_v and more.
        notes: gets what was done.

    Raises:
        DatasetError: all rows bear the same stamp.
    """
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
