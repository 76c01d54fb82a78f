"""Slow tests of a cell: its branches over SOC, and the charge between full and empty.

A slow test is a discharge of C/10 or less, a charge, or both, in one or several recordings. Where nothing was that
slow, the rests of a stepwise discharge stand for it, or discharges at two currents. The charge counter of the rig is
not trusted blindly: branches are laid on the SOC axis by their ends, which are states of the cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.ocv import from_rests, from_two_currents
from app.estimation.errors import ModelError
from app.estimation.identification.branches import (
    Branch,
    find_branches,
    long_rests,
    rest_after,
    rests_of,
    stretches,
)
from app.estimation.recording.cell_recording import Recording

SLOW_C: Final = 0.15  # faster, the drop at the current is no longer small
FAST_C: Final = 1.5  # a discharge from full to empty at more than this is a piece of a drive or of a pulse test
ALIKE_FRAC: Final = 0.8  # share of the largest charge moved: discharges that went as far
RESTS_MIN: Final = 5  # rested points that make a curve
RESTS_SPAN: Final = 0.5  # share of the SOC that they cover
RESTS_BEYOND: Final = 0.02  # tolerance in SOC: counts drift
KNOWN_SHARE: Final = 0.5  # share of the rows whose soc column is filled
CURRENTS_RATIO: Final = 1.5  # between two discharges that tell the drop
COUNT_TOLERANCE: Final = (
    0.03  # share of the capacity: with more disagreement of count and rest voltage the count is wrong
)
REST_SHARE: Final = 0.3  # share of the way from discharge to charge branch: half for diffusion, less with hysteresis
GRID_POINTS: Final = 401
FLAT_V: Final = 0.15  # per unit of SOC: an OCV that rises less determines little
FLAT_SHARE: Final = 0.25  # share of the range: less is a dip that a drive passes
END_SOC: Final = 0.02  # the last part of the discharge ...
END_STEEPNESS: Final = 3.0  # ... falls at least this many times as fast as the middle where a cell is empty


@dataclass(frozen=True)
class SlowCurves:
    """Terminal voltage of the slow branches on one grid of SOC.

    Attributes:
        soc: (n,) rising from 0 to 1.
        discharge_v: (n,) voltage while discharging [V], rising.
        charge_v: (n,) voltage while charging [V], rising; equal to `discharge_v` where no charge was recorded.
        counted_ah: charge the discharge counted from full to empty [Ah].
        current_a: magnitude of the discharge current [A].
        has_charge: a charging branch was recorded as well as a discharge.
        notes: what was assumed, in plain words.
        warnings: what makes the curves uncertaintyful.
    """

    soc: FloatArray
    discharge_v: FloatArray
    charge_v: FloatArray
    counted_ah: float
    current_a: float
    has_charge: bool
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def rested_v(self) -> FloatArray:
        """(n,) voltage that a rest after a discharge comes to [V]: between the branches, nearer the discharge."""
        return self.discharge_v + REST_SHARE * (self.charge_v - self.discharge_v)

    @property
    def flat_share(self) -> float:
        """Share of the SOC over which the OCV rises by less than `FLAT_V`."""
        return float(np.mean(np.diff(self.rested_v) / np.diff(self.soc) < FLAT_V))

    @property
    def is_flat(self) -> bool:
        """Return whether a voltage hardly determines the SOC, so that counted charge counts more."""
        return self.flat_share >= FLAT_SHARE


def read_slow(recordings: Sequence[Recording], pulses: Sequence[Recording] = ()) -> SlowCurves:
    """Return the branches of the slow tests on the SOC axis.

    SOC comes from the soc column where the branch has one. Without it the discharge runs from SOC 1 to 0, and the
    charge starts where its count says and ends where the rest voltage after it lies on the discharge curve, unless the
    count agrees within 3 %. A charge alone runs from SOC 0 to 1.

    Args:
        recordings: one or more slow tests of the same cell.
        pulses: pulse tests, whose rests stand for the OCV where the slow test is not slow.

    Raises:
        ModelError: no recording holds a branch, one has too few samples, its current is no slow test's, or nothing
            measured the OCV.
    """
    discharges, charges = find_branches(recordings)
    if not discharges and not charges:
        raise ModelError("--ocv", "no current flows one way for long: a slow discharge or charge is needed")
    notes: list[str] = []
    warnings: list[str] = []
    base = _slowest(discharges or charges)
    soc, counted_ah = _base_soc(base)
    grid = np.linspace(0.0, 1.0, GRID_POINTS)
    rate_c = base.current_a / counted_ah
    if rate_c <= SLOW_C:
        discharge_v = _on_grid(grid, soc, base.recording.voltage_v[base.rows])
        if not charges:
            discharge_v = _raised_to_rests(base, soc, grid, discharge_v, notes)
    else:
        at_rest_v = _without_slow(discharges, base, counted_ah, grid, notes)
        if at_rest_v is None:
            at_rest_v = _raised_to_pulses(base, soc, counted_ah, pulses, grid, notes)
        if at_rest_v is None:
            raise ModelError(
                base.recording.source,
                f"nothing measured the OCV: it ran at {rate_c:.2g} C, not at C/10 or less, and its voltage holds the "
                "drop at that current; add a slow discharge, or a stepwise one whose charge is counted, with rests of "
                "ten minutes",
            )
        discharge_v = at_rest_v
        charges = []
    if base.moved_ah < 0.0:
        notes.append(f"{base.recording.source}: no slow discharge: the OCV follows the charge")
    _uncertainty_the_end(grid, discharge_v, base, warnings)
    charge_v = discharge_v
    if discharges and charges:
        charge = charges[0]
        charge_soc = charge.soc
        if charge_soc is None:
            charge_soc = _charge_soc(charge, counted_ah, grid, discharge_v, notes)
        charge_v = _on_grid(grid, charge_soc, charge.recording.voltage_v[charge.rows], discharge_v)
    return SlowCurves(
        soc=grid,
        discharge_v=discharge_v,
        charge_v=np.maximum(charge_v, discharge_v),
        counted_ah=counted_ah,
        current_a=base.current_a,
        has_charge=bool(discharges and charges),
        notes=tuple(notes),
        warnings=tuple(warnings),
    )


def _slowest(branches: Sequence[Branch]) -> Branch:
    far = [branch for branch in branches if abs(branch.moved_ah) >= ALIKE_FRAC * abs(branches[0].moved_ah)]
    return min(far, key=lambda branch: branch.current_a)


def _base_soc(base: Branch) -> tuple[FloatArray, float]:
    """Return the (n,) SOC of the branch that the others are laid on, and its charge from full to empty [Ah]."""
    counted_ah = abs(base.moved_ah)
    soc = base.soc
    if soc is not None:
        return soc, counted_ah / max(float(abs(soc[0] - soc[-1])), 1e-6)
    return (1.0 if base.moved_ah > 0.0 else 0.0) - base.drawn_ah / counted_ah, counted_ah


def _raised_to_rests(
    base: Branch, soc: FloatArray, grid: FloatArray, loaded_v: FloatArray, notes: list[str]
) -> FloatArray:
    """Return the curve of a stepwise slow discharge with the drop given back that its rests show."""
    rests = rests_of(base)
    rests = rests[rests > base.rows[0]]
    if base.moved_ah < 0.0 or rests.size < RESTS_MIN:
        return loaded_v
    before = np.searchsorted(base.rows, rests) - 1
    volts = base.recording.voltage_v
    drop_v = np.maximum(volts[rests] - volts[base.rows[before]], 0.0)
    notes.append(
        f"{base.recording.source}: its OCV is raised to {rests.size} rests, by {1e3 * np.median(drop_v):.0f} mV"
    )
    return np.maximum.accumulate(loaded_v + np.interp(grid, soc[before][::-1], drop_v[::-1]))


def _raised_to_pulses(
    base: Branch, soc: FloatArray, counted_ah: float, pulses: Sequence[Recording], grid: FloatArray, notes: list[str]
) -> FloatArray | None:
    """Return the curve of a fast discharge with the drop given back that the rests of pulse tests show; None without.

    The SOC of a rest is that of the soc column, else the charge counted since the cell was full.
    """
    found_soc, found_v = [], []
    for recording in pulses:
        rests = long_rests(recording)
        if np.isfinite(recording.soc).mean() > KNOWN_SHARE:
            at = recording.soc[rests]
        elif len(stretches(recording)) == 1 and float(np.ptp(recording.seen_charge_ah)) > 0.5 * counted_ah:
            at = 1.0 - (recording.seen_charge_ah[rests] - recording.seen_charge_ah.min()) / counted_ah
        else:
            continue
        found_soc.append(at)
        found_v.append(recording.voltage_v[rests])
    at, volts = (np.concatenate(parts) if parts else np.zeros(0) for parts in (found_soc, found_v))
    is_usable = np.isfinite(at) & np.isfinite(volts) & (at >= 0.0) & (at <= 1.0 + RESTS_BEYOND)
    at, volts = at[is_usable], volts[is_usable]
    if np.unique(np.round(at, 2)).size < RESTS_MIN or float(np.ptp(at)) < RESTS_SPAN:
        return None
    loaded_v = _on_grid(grid, soc, base.recording.voltage_v[base.rows])
    bins = np.round(at, 2)
    where = np.unique(bins)
    drop_v = np.array([np.median(volts[bins == one] - np.interp(at[bins == one], grid, loaded_v)) for one in where])
    notes.append(
        f"no slow test: the OCV is {base.recording.source}, raised to {where.size} rests of the pulse tests, by "
        f"{1e3 * np.median(drop_v):.0f} mV"
    )
    return np.maximum.accumulate(loaded_v + np.interp(grid, where, np.maximum(drop_v, 0.0)))


def _without_slow(
    discharges: Sequence[Branch],
    base: Branch,
    counted_ah: float,
    grid: FloatArray,
    notes: list[str],
) -> FloatArray | None:
    """Return the voltage at rest over the grid where no branch is slow: from rests, from two currents, else None.

    Raises:
        ModelError: the only branch is too fast to be one from full to empty.
    """
    source, rate_c = base.recording.source, base.current_a / counted_ah
    rests = rests_of(base)
    if rests.size >= RESTS_MIN:
        notes.append(f"{source}: no slow test: the OCV runs through {rests.size} rests of a stepwise discharge")
        charge = base.recording.seen_charge_ah
        base_soc, _ = _base_soc(base)
        soc = base_soc[0] - (charge[rests] - charge[base.rows[0]]) / counted_ah
        inside = (soc >= -0.05) & (soc <= 1.05)
        curve = from_rests(soc[inside], base.recording.voltage_v[rests][inside])
        return np.maximum.accumulate(curve.voltage(grid))
    faster = [b for b in discharges if b.current_a >= CURRENTS_RATIO * base.current_a]
    if faster:
        other = faster[0]
        notes.append(
            f"no slow test: the OCV is extrapolated from {source} at {base.current_a:.3g} A "
            f"and {other.recording.source} at {other.current_a:.3g} A"
        )
        return _from_two(base, other, counted_ah, grid)
    if rate_c > FAST_C:
        raise ModelError(source, f"its longest run of current is at {rate_c:.3g} C: no slow test, and without rests")
    return None


def _from_two(low: Branch, high: Branch, counted_ah: float, grid: FloatArray) -> FloatArray:
    """Return the voltage at no current from discharges at two; below the end of the faster its drop is held."""
    low_soc, _ = _base_soc(low)
    low_v = _on_grid(grid, low_soc, low.recording.voltage_v[low.rows])
    high_soc = low_soc[0] - high.drawn_ah / counted_ah if high.soc is None else high.soc
    high_v = _on_grid(grid, high_soc, high.recording.voltage_v[high.rows])
    covered = (grid >= high_soc.min()) & (grid <= high_soc.max())
    drop_v = np.interp(grid, grid[covered], np.maximum(low_v - high_v, 0.0)[covered])
    return from_two_currents(grid, low_v, low_v - drop_v, low.current_a, high.current_a).voltage(grid)


def _uncertainty_the_end(grid: FloatArray, curve_v: FloatArray, base: Branch, warnings: list[str]) -> None:
    """Warn where the curve ends without the steep fall of an empty cell: then SOC 0 is not empty."""
    end = float(np.interp(END_SOC, grid, curve_v) - curve_v[0]) / END_SOC
    usual = float(np.median(np.diff(curve_v) / np.diff(grid)))
    if end < END_STEEPNESS * usual:
        warnings.append(
            f"{base.recording.source} ends at {curve_v[0]:.2f} V, before the steep fall of an empty cell: "
            "SOC 0 and the capacity mean that voltage"
        )


def _charge_soc(
    charge: Branch, counted_ah: float, grid: FloatArray, discharge_v: FloatArray, notes: list[str]
) -> FloatArray:
    recording, first = charge.recording, int(charge.rows[0])
    start = float(np.interp(recording.voltage_v[first - 1], discharge_v, grid)) if first > 0 else 0.0
    start = start if np.isfinite(start) else 0.0
    moved = -charge.drawn_ah / counted_ah
    rest = rest_after(recording, int(charge.rows[-1]))
    if rest is None or not np.isfinite(recording.voltage_v[rest]):
        return start + moved
    drawn_ah = recording.seen_charge_ah
    counted = float(drawn_ah[first] - drawn_ah[rest]) / counted_ah
    rested = float(np.interp(recording.voltage_v[rest], discharge_v, grid)) - start
    if abs(rested - counted) <= COUNT_TOLERANCE or rested <= COUNT_TOLERANCE:
        return start + moved
    notes.append(
        f"{recording.source}: the charge counts {100.0 * (counted / rested - 1.0):+.1f} % against the rest voltage "
        "after it: laid on the SOC axis by its ends"
    )
    return start + moved * rested / counted


def _on_grid(
    grid: FloatArray, soc: FloatArray, voltage_v: FloatArray, outside_v: FloatArray | None = None
) -> FloatArray:
    """Return the never falling mean voltage near each grid point; beyond the branch as given."""
    is_finite = np.isfinite(voltage_v)
    if is_finite.sum() < 10:
        raise ModelError("--ocv", "a slow branch has fewer than ten samples")
    order = np.argsort(soc[is_finite], kind="stable")
    s, v = soc[is_finite][order], voltage_v[is_finite][order]
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
