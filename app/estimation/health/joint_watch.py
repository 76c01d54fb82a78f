"""Names loose joints while driving: every joint is compared with itself as it was before.

Joints differ by more than an early fault does, so each cell's own excess over its peers, averaged over sound driving,
is taken off before it is judged; a joint that is being judged loose teaches nothing. Until a cell's past is known, cell
and joint are distinguished by pattern alone. In 30 races a bolt of +0.3 mohm was named within 40 s, and none else.
What was found stays until driving shows otherwise: standing, a restart and a missing voltage are no evidence.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.errors import ShapeError
from app.estimation.health.joints import JointReport, judge_joints
from app.estimation.health.packs import Packs
from app.estimation.health.resistance_tracker import ResistanceTracker

LAG_S: Final = 0.4
LAG_MAX_S: Final = 0.8
STEP_A: Final = 20.0
BURST_S: Final = 1.5  # without a step: the next one is judged by itself
MEMORY: Final = 4.0  # differences: the first of a step may still hold what was before a joint parted
COUNT_MIN: Final = 2.5


class StepResistance:
    """Call `step` with every sample."""

    def __init__(self, n_cells: int) -> None:
        self._before: deque[tuple[float, float, FloatArray]] = deque(maxlen=64)
        self._time_s = 0.0
        self._learned_s = -np.inf
        self._rises = False
        self._sums = np.zeros((3, n_cells))  # sums of the typical cell's and the cell's difference: x x, x y, y y [V^2]
        self._count = np.zeros(n_cells)
        self.learned = 0  # differences, in all

    def step(self, dt_s: float, current_a: float, voltages_v: FloatArray) -> None:
        """Take one sample: step [s], current [A] positive on discharge, (n_cells,) voltages [V]; NaN = missing."""
        if not abs(current_a) < 1e9:
            return
        self._time_s += dt_s
        while len(self._before) > 1 and self._time_s - self._before[1][0] >= LAG_S:
            self._before.popleft()
        if self._before:
            then_s, then_a, then_v = self._before[0]
            if LAG_S <= self._time_s - then_s <= LAG_MAX_S and abs(current_a - then_a) >= STEP_A:
                share = min(abs((current_a - then_a) / current_a), 1.0) if abs(current_a) > abs(then_a) else 1.0
                self._learn(then_v - voltages_v, share, rises=current_a > then_a)
        self._before.append((self._time_s, current_a, voltages_v))

    def ratio(self) -> FloatArray:
        """Return (n_cells,) resistance over the typical cell's in the last step; NaN while not known."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self._count >= COUNT_MIN, self._sums[1] / self._sums[0], np.nan)

    def sigma(self) -> FloatArray:
        """Return (n_cells,) its standard deviation by the scatter about the line."""
        xx, xy, yy = self._sums
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.maximum(yy - xy * xy / xx, 0.0)
            return np.where(self._count >= COUNT_MIN, np.sqrt(left / xx), np.nan)

    def _learn(self, dropped_v: FloatArray, share: float, *, rises: bool) -> None:
        is_finite = np.isfinite(dropped_v)
        if not is_finite.any():
            return
        if self._time_s - self._learned_s > BURST_S or rises != self._rises:  # the joint may part within a step, too
            self._rises = rises
            self._sums[:] = 0.0
            self._count[:] = 0.0
        self._learned_s = self._time_s
        x = float(np.median(dropped_v[is_finite]))
        y = np.where(is_finite, x + share * (dropped_v - x), 0.0)
        fade = np.where(is_finite, 1.0 - 1.0 / MEMORY, 1.0)
        self._sums *= fade
        self._sums += is_finite * np.array((np.full_like(y, x * x), x * y, y * y))
        self._count = self._count * fade + is_finite
        self.learned += 1


MEMORY_S: Final = 25.0  # time of the regression: less than half a lap, so that a fault shows within the lap
JUDGE_S: Final = 2.5  # between two judgements
FIRST_ALARM_OHM: Final = 1.75e-4  # while a cell's own past is not known
ALARM_OHM: Final = 1.5e-4
LEARN_OHM: Final = 7.5e-5  # beyond this the joint is changing, and so nothing is learnt of it
PAST_JUDGEMENTS: Final = 8  # before the past of a joint counts
CONFIRMATIONS: Final = 3  # judgements in a row
BASELINE_JUDGEMENTS: Final = 120  # in the moving average of a sound joint
QUICK_MEMORY_S: Final = 6.0  # time of a second regression, which shows that a joint has changed
CHANGED_SIGMAS: Final = 5.0  # apart: the slow one remembers another joint
JUMP_OHM: Final = 1e-3  # by which a joint parts within one step of the current
JUMP_SIGMAS: Final = 4.0
PARTED_OHM: Final = 4.5e-4  # more than the first judgement of a sound joint is wrong by
NEW_S: Final = 1.0  # time of driving since the last judgement: less is no new evidence


@dataclass(frozen=True)
class LooseJoints:
    """Loose joints of an earlier session, (n_cells,): their excess and its sigma [ohm]; NaN where sound."""

    excess_ohm: FloatArray
    sigma_ohm: FloatArray


class JointWatch:
    """Call `step` with every sample and `judge` every JUDGE_S seconds."""

    def __init__(
        self,
        packs: Packs,
        baseline_ohm: FloatArray | None = None,
        loose: LooseJoints | None = None,
    ) -> None:
        """Start, or go on with what an earlier session of the same car knew.

        Args:
            packs: which cells share a pack.
            baseline_ohm: (n_cells,) `baseline_ohm` of then [ohm].
            loose: `loose_joints` of the session before.

        Raises:
            ShapeError: it belongs to another number of cells.
        """
        n_cells = packs.n_cells
        nan = np.full(n_cells, np.nan)
        before = LooseJoints(nan, nan) if loose is None else loose
        baseline = nan if baseline_ohm is None else baseline_ohm
        for name, array in (("baseline_ohm", baseline), ("found", before.excess_ohm), ("found", before.sigma_ohm)):
            if array.shape != (n_cells,):
                raise ShapeError(name, (n_cells,), array.shape)
        self._packs = packs
        self._tracker = ResistanceTracker(n_cells, memory_s=MEMORY_S)
        self._quick = ResistanceTracker(n_cells, memory_s=QUICK_MEMORY_S)
        self._steps = StepResistance(n_cells)
        self._steps_judged = 0
        self._jump_sigma_ohm, self._jumped_at_s = np.zeros(n_cells), 0.0
        self._baseline_ohm = baseline.copy()
        self._learnt = np.where(np.isnan(self._baseline_ohm), 0, BASELINE_JUDGEMENTS)
        self._sound_judgements = np.zeros(n_cells, dtype=np.int64)  # number in this session
        self._was_sound = np.zeros(n_cells, dtype=np.bool_)
        self._is_loose = np.isfinite(before.excess_ohm)
        self._in_a_row = np.zeros(n_cells, dtype=np.int64)  # judgements that contradict `_is_loose`
        self._report = JointReport(nan, nan, nan, before.excess_ohm.copy(), before.sigma_ohm.copy(), self._is_loose)
        self._judged_at_s = 0.0  # time in learned seconds
        self._judgements = 0
        self._apart_ohm = np.zeros(n_cells)
        self._growth_sigma = np.full(n_cells, np.inf)

    @property
    def baseline_ohm(self) -> FloatArray:
        """(n_cells,) excess of each cell over its peers while sound [ohm], NaN = not known; for the next session."""
        return self._baseline_ohm.copy()

    @property
    def loose_joints(self) -> LooseJoints:
        """The loose joints; for the next session."""
        joint_ohm, sigma_ohm = self._report.joint_excess_ohm, self._report.sigma_ohm
        return LooseJoints(np.where(self._is_loose, joint_ohm, np.nan), np.where(self._is_loose, sigma_ohm, np.nan))

    @property
    def loose(self) -> BoolArray:
        """(n_cells,) joints judged loose CONFIRMATIONS times in a row, and not sound as often since."""
        return self._is_loose.copy()

    @property
    def was_sound(self) -> BoolArray:
        """(n_cells,) joints that were sound for a while in this session: what grows after that is no aged cell."""
        return self._was_sound

    @property
    def age_s(self) -> float:
        """Seconds since current last showed the resistances; infinite before it did [s]."""
        return self._tracker.age_s

    @property
    def change_ohm(self) -> FloatArray:
        """(n_cells,) how far the last seconds lie from the last half minute: what is changing is not known well."""
        left = np.exp((self._jumped_at_s - self._tracker.learned_s) / MEMORY_S)
        return np.asarray(np.hypot(self._apart_ohm, left * self._jump_sigma_ohm))

    @property
    def growth_sigma(self) -> FloatArray:
        """(n_cells,) standard deviation of a cell's own growth, as a fraction; large while its resistance changes."""
        return self._growth_sigma

    @property
    def evidence_s(self) -> float:
        """Seconds of driving that the regression remembers [s]."""
        return min(self._tracker.learned_s, MEMORY_S)

    @property
    def evidence_count(self) -> int:
        """Judgements that had new evidence."""
        return self._judgements

    @property
    def excitation_a(self) -> float:
        """Rms of the current's movement in what the regression remembers [A]; NaN before there was any."""
        return self._tracker.excitation_a

    def step(self, dt_s: float, current_a: float, voltages_v: FloatArray) -> None:
        """Take one sample: step [s], current [A] positive on discharge, (n_cells,) voltages [V]; NaN = missing."""
        self._tracker.step(dt_s, current_a, voltages_v)
        self._quick.step(dt_s, current_a, voltages_v)
        self._steps.step(dt_s, current_a, voltages_v)

    def judge(self) -> JointReport:
        """Return what the resistances say; `joint_excess_ohm` is against the cell's own past where known.

        Without driving since the last judgement it is the last judgement; a cell of which nothing new is known keeps
        its own.
        """
        jumped = self._jumped()
        if self._tracker.learned_s - self._judged_at_s < NEW_S and not jumped.any():
            return self._report
        self._judged_at_s = self._tracker.learned_s
        self._judgements += 1
        self._forget_what_changed()
        has_past = self._learnt >= PAST_JUDGEMENTS
        report = self._compare(has_past)
        has_parted = (self._sound_judgements > 0) & (report.ohmic_excess_ohm - self._baseline_ohm > PARTED_OHM)
        if np.any(has_parted & ~has_past):  # a short past shows a large growth better than the pattern does
            has_past |= has_parted
            report = self._compare(has_past)
        self._was_sound = has_parted | (self._sound_judgements >= PAST_JUDGEMENTS)
        is_loose = report.is_loose & (has_past | (report.joint_excess_ohm > FIRST_ALARM_OHM))
        self._confirm(is_loose, np.asarray(report.joint_excess_ohm + report.sigma_ohm < ALARM_OHM))
        self._is_loose |= jumped & is_loose
        self._learn(report, is_loose, has_past)
        self._report = _with_earlier(self._report, replace(report, is_loose=is_loose))
        return self._report

    def _compare(self, has_past: BoolArray) -> JointReport:
        return judge_joints(
            self._tracker.resistance_ohm(),
            self._tracker.sigma_ohm(),
            self._packs,
            alarm_ohm=ALARM_OHM,
            baseline_ohm=np.where(has_past, self._baseline_ohm, np.nan),
        )

    def _forget_what_changed(self) -> None:
        """Take the quick regression's word for cells that no longer resist as the slow one remembers."""
        slow, quick = self._tracker, self._quick
        slow_ohm, slow_sigma_ohm = slow.resistance_ohm(), slow.sigma_ohm()
        sigma_ohm = np.hypot(slow_sigma_ohm[0], quick.sigma_ohm()[0])
        apart_ohm, pair_apart_ohm = np.abs(slow_ohm - quick.resistance_ohm())
        self._apart_ohm = np.nan_to_num(apart_ohm)
        known_ohm = slow_ohm[1][np.isfinite(slow_ohm[1])]
        if known_ohm.size:
            pair_ohm = max(abs(float(np.median(known_ohm))), 1e-9)
            self._growth_sigma = np.hypot(slow_sigma_ohm[1], pair_apart_ohm) / pair_ohm
        slow.adopt(quick, np.asarray(apart_ohm > np.maximum(CHANGED_SIGMAS * sigma_ohm, ALARM_OHM)))

    def _jumped(self) -> BoolArray:
        """Return the cells that resist far more in the last steps than by the regression, and set that to it."""
        if self._steps.learned == self._steps_judged:
            return np.zeros(len(self._is_loose), dtype=np.bool_)
        self._steps_judged = self._steps.learned
        ratio, slow_ohm = self._steps.ratio(), self._tracker.resistance_ohm()[0]
        known_ohm = slow_ohm[np.isfinite(slow_ohm)]
        if not known_ohm.size:
            return np.zeros(len(ratio), dtype=np.bool_)
        usual_ohm = float(np.median(known_ohm))
        apart_ohm, sigma_ohm = ratio * usual_ohm - slow_ohm, self._steps.sigma() * usual_ohm
        jumped = np.asarray(np.nan_to_num(apart_ohm) > np.maximum(JUMP_OHM, JUMP_SIGMAS * np.nan_to_num(sigma_ohm)))
        if jumped.any():
            self._jump_sigma_ohm[jumped] = sigma_ohm[jumped]
            self._jumped_at_s = self._tracker.learned_s
            for tracker in (self._tracker, self._quick):
                tracker.set_ohmic(ratio * usual_ohm, jumped)
        return jumped

    def _confirm(self, is_loose: BoolArray, is_sound: BoolArray) -> None:
        """Turn what CONFIRMATIONS judgements in a row contradict; one that is neither loose nor sound says nothing."""
        contradicts = np.where(self._is_loose, is_sound & ~is_loose, is_loose)
        agrees = np.where(self._is_loose, is_loose, is_sound & ~is_loose)
        self._in_a_row = np.where(contradicts, self._in_a_row + 1, np.where(agrees, 0, self._in_a_row))
        turns = self._in_a_row >= CONFIRMATIONS
        self._is_loose = self._is_loose ^ turns
        self._in_a_row[turns] = 0

    def _learn(self, report: JointReport, is_loose: BoolArray, has_past: BoolArray) -> None:
        excess_ohm = report.ohmic_excess_ohm
        # a large excess that is not sure yet, of joint or cell, is no past: it would hide the joint from then on
        is_like = (report.joint_excess_ohm < FIRST_ALARM_OHM) & (excess_ohm < PARTED_OHM)
        steady = np.where(has_past, np.abs(report.joint_excess_ohm) < LEARN_OHM, is_like)
        sound = np.isfinite(excess_ohm) & ~is_loose & ~self._is_loose & steady
        self._sound_judgements += sound
        self._learnt = np.where(sound, np.minimum(self._learnt + 1, BASELINE_JUDGEMENTS), self._learnt)
        baseline_ohm = np.nan_to_num(self._baseline_ohm)
        moved = baseline_ohm + (np.nan_to_num(excess_ohm) - baseline_ohm) / np.maximum(self._learnt, 1)
        self._baseline_ohm = np.where(sound, moved, self._baseline_ohm)


def _with_earlier(before: JointReport, now: JointReport) -> JointReport:
    """Return what is known now, cell by cell what was known before where that is nothing."""
    is_known = np.isfinite(now.joint_excess_ohm)
    if is_known.all():
        return now
    pairs = {field.name: (getattr(now, field.name), getattr(before, field.name)) for field in fields(JointReport)}
    return JointReport(**{name: np.where(is_known, new, old) for name, (new, old) in pairs.items()})
