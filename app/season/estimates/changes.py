"""Changes by estimating again: two results of each session compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.analysis.totals import number
from app.estimation.arrays import FloatArray


@dataclass(frozen=True)
class EstimateChange:
    """One session: medians over the cells, and the cell that moved most; None where one of the two says nothing.

    `soc_rms` is how far the SOC of all cells lies from the one that was recorded, over all samples.
    """

    session: str
    name: str
    start_s: float
    recorded_by: str
    soc_recorded: float | None
    soc_before: float | None
    soc_after: float | None
    soc_rms: float | None
    soc_cell: int | None
    soc_cell_moved: float | None
    resistance_before: float | None
    resistance_after: float | None
    capacity_before_ah: float | None
    capacity_after_ah: float | None
    innovation_before_v: float | None
    innovation_after_v: float | None


def changes(before: Sequence[dict[str, Any]], after: Sequence[dict[str, Any]]) -> list[EstimateChange]:
    """Return what changed in every session of `after`; resistance is over that of each one's own cell file."""
    old = {result["session"]: result for result in before}
    return [_change(old.get(result["session"]), result) for result in after]


def _change(before: dict[str, Any] | None, after: dict[str, Any]) -> EstimateChange:
    recorded, last = _cells(after, "recorded_soc_last"), _cells(after, "soc_last")
    base = recorded if np.isfinite(recorded).any() else _cells(before, "soc_last")
    moved = last - base if base.shape == last.shape else np.full(last.shape, np.nan)
    cell = int(np.nanargmax(np.abs(moved))) if np.isfinite(moved).any() else None
    return EstimateChange(
        session=after["session"],
        name=after["name"],
        start_s=after["start_s"],
        recorded_by=after["recorded_by"],
        soc_recorded=_median(recorded),
        soc_before=_median(_cells(before, "soc_last")),
        soc_after=_median(last),
        soc_rms=after["recorded_soc_rms"],
        soc_cell=cell,
        soc_cell_moved=None if cell is None else number(moved[cell]),
        resistance_before=_median(_cells(before, "resistance_factor")),
        resistance_after=_median(_cells(after, "resistance_factor")),
        capacity_before_ah=_median(_cells(before, "capacity_ah")),
        capacity_after_ah=_median(_cells(after, "capacity_ah")),
        innovation_before_v=_median(_cells(before, "innovation_rms_v")),
        innovation_after_v=_median(_cells(after, "innovation_rms_v")),
    )


def _cells(result: dict[str, Any] | None, name: str) -> FloatArray:
    return np.empty(0) if result is None else np.array(result[name], dtype=np.float64)


def _median(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else None
