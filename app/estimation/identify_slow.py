"""What a slow test says about a cell: its branches over SOC, and the charge between full and empty.

A slow test is a discharge of C/10 or less, a charge, or both, in one or several recordings. The charge counter of the
rig is not trusted blindly: branches are laid on the SOC axis by their ends, which are states of the cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.errors import ModelError
from app.estimation.importer import GAP_STEPS, FloatArray, Recording

BranchPoints = tuple[FloatArray, FloatArray]

BRANCH_CURRENT_FRAC: Final = 0.3  # of the largest current: below, the test rests or holds the voltage
BRANCH_CHARGE_FRAC: Final = 0.3  # of the largest charge moved one way: a branch moves at least this much
COUNT_TOLERANCE: Final = 0.03  # of the capacity: more disagreement of count and rest voltage and the count is wrong
REST_SHARE: Final = 0.3  # of the way from discharge to charge branch: half for diffusion, less with hysteresis
GRID_POINTS: Final = 401


@dataclass(frozen=True)
class SlowCurves:
    """Terminal voltage of the slow branches on one grid of SOC.

    Attributes:
        soc: (n,) rising from 0 to 1.
        discharge_v: (n,) voltage while discharging [V], rising.
        charge_v: (n,) voltage while charging [V], rising; equal to `discharge_v` where no charge was recorded.
        counted_ah: charge the discharge counted from full to empty [Ah].
        current_a: magnitude of the discharge current [A].
        temperature_degc: mean temperature [degC], NaN if not recorded.
        has_charge: a charging branch was recorded.
        notes: what was assumed, in plain words.
    """

    soc: FloatArray
    discharge_v: FloatArray
    charge_v: FloatArray
    counted_ah: float
    current_a: float
    temperature_degc: float
    has_charge: bool
    notes: tuple[str, ...]

    @property
    def rested_v(self) -> FloatArray:
        """(n,) voltage that a rest after a discharge comes to [V]: between the branches, nearer the discharge."""
        return self.discharge_v + REST_SHARE * (self.charge_v - self.discharge_v)


def read_slow(recordings: Sequence[Recording]) -> SlowCurves:
    """Return the branches of the slow tests on the SOC axis.

    SOC comes from the soc column where the branch has one. Without it the discharge runs from SOC 1 to 0, and the
    charge starts where its count says and ends where the rest voltage after it lies on the discharge curve, unless the
    count agrees within 3 %.

    Args:
        recordings: one or more slow tests of the same cell.

    Raises:
        ModelError: no recording holds a discharge, or a branch has too few samples.
    """
    branches = [(r, b) for r in recordings for b in _branches(r)]
    discharges = [(r, b) for r, b in branches if r.current_a[b].mean() > 0.0]
    charges = [(r, b) for r, b in branches if r.current_a[b].mean() < 0.0]
    if not discharges:
        raise ModelError("--ocv", "no slow discharge found: positive current over most of the capacity")
    notes: list[str] = []
    recording, rows = max(discharges, key=lambda item: _moved_ah(*item))
    counted_ah = _moved_ah(recording, rows)
    soc = _column_soc(recording, rows)
    if soc is None:
        soc = 1.0 - (_charge(recording)[rows] - _charge(recording)[rows[0]]) / counted_ah
    else:
        counted_ah /= max(float(soc[0] - soc[-1]), 1e-6)
    grid = np.linspace(0.0, 1.0, GRID_POINTS)
    discharge_v = _on_grid(grid, soc, recording.voltage_v[rows])
    charge_v = discharge_v
    if charges:
        other, charge_rows = max(charges, key=lambda item: _moved_ah(*item))
        charge_soc = _column_soc(other, charge_rows)
        if charge_soc is None:
            charge_soc = _charge_soc(other, charge_rows, counted_ah, grid, discharge_v, notes)
        charge_v = _on_grid(grid, charge_soc, other.voltage_v[charge_rows], discharge_v)
    temperatures = recording.temperature_degc[rows]
    return SlowCurves(
        soc=grid,
        discharge_v=discharge_v,
        charge_v=np.maximum(charge_v, discharge_v),
        counted_ah=counted_ah,
        current_a=float(np.median(recording.current_a[rows])),
        temperature_degc=float(temperatures.mean()),
        has_charge=bool(charges),
        notes=tuple(notes),
    )


def _branches(recording: Recording) -> list[NDArray[np.intp]]:
    """Return the row numbers of every long run of current of one sign."""
    current = recording.current_a
    sign = np.sign(current) * (np.abs(current) > BRANCH_CURRENT_FRAC * np.abs(current).max())
    edges = np.flatnonzero(np.diff(sign)) + 1
    runs = [run for run in np.split(np.arange(len(sign)), edges) if sign[run[0]] != 0.0 and len(run) >= 10]
    if not runs:
        return []
    moved = [_moved_ah(recording, run) for run in runs]
    return [run for run, ah in zip(runs, moved, strict=True) if ah >= BRANCH_CHARGE_FRAC * max(moved)]


def _charge(recording: Recording) -> FloatArray:
    """Return the (n,) charge drawn [Ah], with nothing counted over gaps."""
    mean_a = 0.5 * (recording.current_a[1:] + recording.current_a[:-1])
    steps = np.diff(recording.time_s)
    steps = np.where(steps > GAP_STEPS * recording.usual_step_s, 0.0, steps)
    return np.concatenate(([0.0], np.cumsum(mean_a * steps) / 3600.0))


def _moved_ah(recording: Recording, rows: NDArray[np.intp]) -> float:
    charge = _charge(recording)
    return abs(float(charge[rows[-1]] - charge[rows[0]]))


def _column_soc(recording: Recording, rows: NDArray[np.intp]) -> FloatArray | None:
    soc = recording.soc[rows]
    return soc if bool(np.isfinite(soc).all()) and float(np.ptp(soc)) > 0.0 else None


def _charge_soc(
    recording: Recording,
    rows: NDArray[np.intp],
    counted_ah: float,
    grid: FloatArray,
    discharge_v: FloatArray,
    notes: list[str],
) -> FloatArray:
    charge = _charge(recording)
    start = float(np.interp(recording.voltage_v[rows[0] - 1], discharge_v, grid)) if rows[0] > 0 else 0.0
    moved: FloatArray = (charge[rows[0]] - charge[rows]) / counted_ah
    rest = _rest_after(recording, int(rows[-1]))
    if rest is None:
        return start + moved
    counted = (charge[rows[0]] - charge[rest]) / counted_ah
    rested = float(np.interp(recording.voltage_v[rest], discharge_v, grid)) - start
    if abs(rested - counted) <= COUNT_TOLERANCE:
        return start + moved
    notes.append(
        f"{recording.source}: the charge counts {100.0 * (counted / rested - 1.0):+.1f} % against the rest voltage "
        "after it: laid on the SOC axis by its ends"
    )
    scale = rested / float(counted)
    return start + moved * scale


def _rest_after(recording: Recording, row: int) -> int | None:
    """Return the last row of the rest that follows a branch, before any gap; None without a rest."""
    idle = np.abs(recording.current_a) < 0.05 * np.abs(recording.current_a).max()
    after = np.flatnonzero(idle[row:])
    if after.size == 0:
        return None
    begin = row + int(after[0])
    stop = np.flatnonzero(~idle[begin:] | (recording.step_s[begin:] > GAP_STEPS * recording.usual_step_s))
    stop = stop[stop > 0]
    return begin + int(stop[0]) - 1 if stop.size else len(idle) - 1


def _on_grid(
    grid: FloatArray, soc: FloatArray, voltage_v: FloatArray, outside_v: FloatArray | None = None
) -> FloatArray:
    """Return the never falling mean voltage near each grid point; beyond the branch as given."""
    known = np.isfinite(voltage_v)
    if known.sum() < 10:
        raise ModelError("--ocv", "a slow branch has fewer than ten samples")
    order = np.argsort(soc[known], kind="stable")
    s, v = soc[known][order], voltage_v[known][order]
    bins = np.round(s * (GRID_POINTS - 1)).astype(np.int64)
    _, index = np.unique(bins, return_inverse=True)
    count = np.bincount(index)
    mean_s, mean_v = np.bincount(index, s) / count, np.bincount(index, v) / count
    result = np.interp(grid, mean_s, mean_v)
    if outside_v is not None:
        covered = (grid >= mean_s[0] - 1e-9) & (grid <= mean_s[-1] + 1e-9)
        gap = result - outside_v
        gap = np.interp(grid, grid[covered], gap[covered]) if covered.any() else np.zeros_like(grid)
        result = outside_v + np.where(covered, gap, np.maximum(gap, 0.0))
    return np.maximum.accumulate(result)
