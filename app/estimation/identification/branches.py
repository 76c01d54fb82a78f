"""Finds the branches of slow tests: what was drawn or put in one way, rests in between included, and where it ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray, IntArray
from app.estimation.errors import ModelError
from app.estimation.recording.cell_recording import GAP_STEPS, Recording

GAP_S: Final = 60.0  # a shorter hole in the record cannot hide a discharge
REST_S: Final = 600.0  # a rest this long ends near the OCV
BRANCH_CURRENT_FRAC: Final = 0.3  # share of the largest current: below, the test rests or holds the voltage
BRANCH_CHARGE_FRAC: Final = 0.3  # share of the largest charge moved one way: a branch moves at least this much
IDLE_FRAC: Final = 0.05  # share of the largest current: below, the cell rests
TURN_FRAC: Final = 0.05  # share of the charge moved at all: a way back that is shorter, like a pulse, is no turn
ROWS_MIN: Final = 10


@dataclass(frozen=True)
class Branch:
    """Rows under current of one sign; a rest between them does not part a branch.

    Attributes:
        recording: where they are from.
        rows: (n,) their numbers.
        moved_ah: charge drawn from the first to the last of them, negative for a charge [Ah].
        current_a: median magnitude [A].
    """

    recording: Recording
    rows: IntArray
    moved_ah: float
    current_a: float

    @property
    def soc(self) -> FloatArray | None:
        """(n,) SOC by the recording's own column, None where it has none."""
        soc = self.recording.soc[self.rows]
        return soc if bool(np.isfinite(soc).all()) and float(np.ptp(soc)) > 0.0 else None

    @property
    def drawn_ah(self) -> FloatArray:
        """(n,) charge drawn since its first row [Ah]."""
        charge = self.recording.seen_charge_ah[self.rows]
        return np.asarray(charge - charge[0])


def find_branches(recordings: Sequence[Recording]) -> tuple[list[Branch], list[Branch]]:
    """Return the discharges and the charges, the largest of each first.

    Raises:
        ModelError: the voltage moves with the wrong sign along a branch.
    """
    branches = [branch for recording in recordings for branch in _branches(recording)]
    for branch in branches:
        volts = branch.recording.voltage_v[branch.rows]
        share = max(volts.size // 10, 1)
        if np.sign(np.nanmean(volts[:share]) - np.nanmean(volts[-share:])) == -np.sign(branch.moved_ah):
            raise ModelError(
                branch.recording.source,
                "the voltage moves against the current; if charging is positive, pass --charge-positive",
            )
    branches.sort(key=lambda branch: -abs(branch.moved_ah))
    return [b for b in branches if b.moved_ah > 0.0], [b for b in branches if b.moved_ah < 0.0]


def stretches(recording: Recording) -> list[IntArray]:
    """Return the rows of each stretch in which no charge can have moved unseen."""
    steps = recording.step_s
    hole = steps > max(GAP_S, GAP_STEPS * recording.usual_step_s)
    idle = np.abs(recording.current_a) < 1e-3 * max(recording.largest_a, 1e-9)
    hole[1:] &= ~(idle[1:] & idle[:-1]) | (steps[1:] > REST_S)
    return [rows for rows in np.split(np.arange(steps.size), np.flatnonzero(hole)) if rows.size]


def rest_after(recording: Recording, row: int) -> int | None:
    """Return the last row of the rest that follows a row, before any gap; None without a rest."""
    idle = _idle(recording)
    after = np.flatnonzero(idle[row:])
    if after.size == 0:
        return None
    begin = row + int(after[0])
    stop = np.flatnonzero(~idle[begin:] | (recording.step_s[begin:] > GAP_STEPS * recording.usual_step_s))
    stop = stop[stop > 0]
    return begin + int(stop[0]) - 1 if stop.size else len(idle) - 1


def long_rests(recording: Recording, first: int = 0, last: int | None = None) -> IntArray:
    """Return the last rows of the long rests that reach into rows `first` to `last`."""
    idle, last = _idle(recording), len(recording.time_s) if last is None else last
    rests = []
    for run in np.split(np.arange(idle.size), np.flatnonzero(np.diff(idle)) + 1):
        lasted_s = recording.time_s[run[-1]] - recording.time_s[run[0]]
        is_long = idle[run[0]] and (lasted_s >= REST_S or run[0] == 0)
        if is_long and first <= run[-1] and run[0] <= last and np.isfinite(recording.voltage_v[run[-1]]):
            rests.append(int(run[-1]))
    return np.array(rests, dtype=np.intp)


def rests_of(branch: Branch) -> IntArray:
    """Return the last rows of the long rests before, within and after a branch."""
    return long_rests(branch.recording, int(branch.rows[0]) - 1, int(branch.rows[-1]) + 1)


def _idle(recording: Recording) -> NDArray[np.bool_]:
    return np.asarray(np.abs(recording.current_a) < IDLE_FRAC * recording.largest_a)


def _branches(recording: Recording) -> list[Branch]:
    charge = recording.seen_charge_ah
    branches = []
    for stretch in stretches(recording):
        for rows in _legs(recording.current_a[stretch], charge[stretch], recording.largest_a):
            at = stretch[rows]
            moved_ah = float(charge[at[-1]] - charge[at[0]])
            branches.append(Branch(recording, at, moved_ah, float(np.median(np.abs(recording.current_a[at])))))
    most_ah = max((abs(branch.moved_ah) for branch in branches), default=0.0)
    return [b for b in branches if b.moved_ah != 0.0 and abs(b.moved_ah) >= BRANCH_CHARGE_FRAC * most_ah]


def _legs(current_a: FloatArray, charge_ah: FloatArray, largest_a: float) -> list[IntArray]:
    """Return the rows under load of every way of the charge from one turn to the next; short ways back are no turn."""
    sign = np.sign(current_a) * (np.abs(current_a) > BRANCH_CURRENT_FRAC * largest_a)
    loaded = np.flatnonzero(sign)
    if loaded.size < ROWS_MIN:
        return []
    runs = np.split(loaded, np.flatnonzero(np.diff(sign[loaded])) + 1)
    turn_ah = TURN_FRAC * float(np.ptp(charge_ah))
    legs: list[IntArray] = []
    start, furthest, way = 0, 0, sign[runs[0][0]]
    for k in range(1, len(runs) + 1):
        beyond = turn_ah if k == len(runs) else way * (charge_ah[runs[furthest][-1]] - charge_ah[runs[k][-1]])
        if beyond >= turn_ah:
            rows = np.concatenate(runs[start : furthest + 1])
            rows = rows[sign[rows] == way]
            legs += [rows] if rows.size >= ROWS_MIN else []
            start, furthest, way = furthest + 1, k, -way
        elif beyond < 0.0:
            furthest = k
    return legs
