"""Gives every row of a recording a stamp of its own, with notes of what was done."""

from __future__ import annotations

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.errors import DatasetError


def usual_step(time_s: FloatArray) -> float:
    """Return the median of the steps of (n,) stamps that are not zero [s], 1 where there is none."""
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if steps.size else 1.0


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
