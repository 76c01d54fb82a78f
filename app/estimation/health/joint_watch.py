"""Names loose joints while driving: every joint is compared with itself as it was before.

Joints differ by more than an early fault does, so each cell's own excess over its peers, averaged over sound driving,
is taken off before it is judged; a joint that is being judged loose teaches nothing. Until a cell's past is known, cell
and joint are told apart by pattern alone. In 30 races a bolt of +0.3 mohm was named within 40 s, and none else.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.errors import ShapeError
from app.estimation.health.joints import JointReport, ResistanceTracker, judge_joints

MEMORY_S: Final = 25.0  # of the regression: less than half a lap, so that a fault shows within the lap
JUDGE_S: Final = 2.5  # between two judgements
FIRST_ALARM_OHM: Final = 1.75e-4  # while a cell's own past is not known
ALARM_OHM: Final = 1.5e-4
LEARN_OHM: Final = 7.5e-5  # beyond this the joint is changing, and so nothing is learnt of it
PAST_JUDGEMENTS: Final = 8  # before the past of a joint is believed
CONFIRMATIONS: Final = 3  # judgements in a row
BASELINE_JUDGEMENTS: Final = 120  # in the moving average of a sound joint


class JointWatch:
    """Call `step` with every sample and `judge` every JUDGE_S seconds."""

    def __init__(self, n_cells: int, cells_per_pack: int, baseline_ohm: FloatArray | None = None) -> None:
        """Start, or go on with the `baseline_ohm` (n_cells,) of an earlier session of the same car [ohm].

        Raises:
            ShapeError: the baseline belongs to another number of cells.
        """
        if baseline_ohm is not None and baseline_ohm.shape != (n_cells,):
            raise ShapeError("baseline_ohm", (n_cells,), baseline_ohm.shape)
        self._cells_per_pack = cells_per_pack
        self._tracker = ResistanceTracker(n_cells, memory_s=MEMORY_S)
        self._baseline_ohm = np.full(n_cells, np.nan) if baseline_ohm is None else baseline_ohm.copy()
        self._learnt = np.where(np.isnan(self._baseline_ohm), 0, BASELINE_JUDGEMENTS)
        self._in_a_row = np.zeros(n_cells, dtype=np.int64)

    @property
    def baseline_ohm(self) -> FloatArray:
        """(n_cells,) excess of each cell over its peers while sound [ohm], NaN = not known; for the next session."""
        return self._baseline_ohm.copy()

    @property
    def loose(self) -> BoolArray:
        """(n_cells,) joints judged loose CONFIRMATIONS times in a row."""
        return np.asarray(self._in_a_row >= CONFIRMATIONS)

    def step(self, dt_s: float, current_a: float, voltages_v: FloatArray) -> None:
        """Take one sample: step [s], current [A] positive on discharge, (n_cells,) voltages [V]; NaN = missing."""
        self._tracker.step(dt_s, current_a, voltages_v)

    def judge(self) -> JointReport:
        """Return what the resistances say now; `joint_excess_ohm` is against the cell's own past where known."""
        has_past = self._learnt >= PAST_JUDGEMENTS
        resistance_ohm, sigma_ohm = self._tracker.resistance_ohm(), self._tracker.sigma_ohm()
        report = judge_joints(
            resistance_ohm,
            sigma_ohm,
            self._cells_per_pack,
            alarm_ohm=ALARM_OHM,
            baseline_ohm=np.where(has_past, self._baseline_ohm, np.nan),
        )
        is_loose = report.is_loose & (has_past | (report.joint_excess_ohm > FIRST_ALARM_OHM))
        self._in_a_row = np.where(is_loose, self._in_a_row + 1, 0)
        self._learn(report, is_loose, has_past)
        return replace(report, is_loose=is_loose)

    def _learn(self, report: JointReport, is_loose: BoolArray, has_past: BoolArray) -> None:
        excess_ohm = report.ohmic_excess_ohm
        steady = ~has_past | (np.abs(report.joint_excess_ohm) < LEARN_OHM)
        sound = np.isfinite(excess_ohm) & ~is_loose & steady
        self._learnt = np.where(sound, np.minimum(self._learnt + 1, BASELINE_JUDGEMENTS), self._learnt)
        known = np.nan_to_num(self._baseline_ohm)
        moved = known + (np.nan_to_num(excess_ohm) - known) / np.maximum(self._learnt, 1)
        self._baseline_ohm = np.where(sound, moved, self._baseline_ohm)
