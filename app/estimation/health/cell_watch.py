"""What is wrong with which cell: the one judge of joints, capacities, leaks and sensors, live and over a session.

Feed `step` with every sample and call `judge` every JUDGE_S seconds. Times are labels: any clock that does not run
backwards within a session; unix time lets findings live through a restart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.cell_finding import CellFinding, confidence_of
from app.estimation.health.joint_watch import ALARM_OHM, JUDGE_S, JointWatch, LooseJoints
from app.estimation.health.joints import JointReport

__all__ = ["JUDGE_S", "CellWatch", "CellWatchMemory"]

SIGMA_MIN_FRAC: Final = 0.02  # of a size: gain of the current sensor, and what a model leaves out


@dataclass(frozen=True)
class CellWatchMemory:
    """What a session leaves to the next one of the same cells.

    Attributes:
        joint_baseline_ohm: (n_cells,) of `JointWatch`.
        loose: joints that were loose.
        findings: what was found.
    """

    joint_baseline_ohm: FloatArray
    loose: LooseJoints | None = None
    findings: tuple[CellFinding, ...] = ()


class CellWatch:
    """All that is watched of every cell."""

    def __init__(
        self, cell: CellModel, n_cells: int, cells_per_pack: int, memory: CellWatchMemory | None = None
    ) -> None:
        """Start, or go on with what an earlier session left.

        Raises:
            ShapeError: the memory belongs to another number of cells.
        """
        self._cell = cell
        self._cells_per_pack = cells_per_pack
        before = memory or CellWatchMemory(np.full(n_cells, np.nan))
        self._joint_watch = JointWatch(n_cells, cells_per_pack, before.joint_baseline_ohm, before.loose)
        self._findings = {(each.code, each.cell): each for each in before.findings}
        self._time_s = -np.inf
        self._typical_ohm = float("nan")
        self.joints: JointReport | None = None

    @property
    def memory(self) -> CellWatchMemory:
        """What to keep for the next session."""
        return CellWatchMemory(self._joint_watch.baseline_ohm, self._joint_watch.found, self.findings)

    @property
    def findings(self) -> tuple[CellFinding, ...]:
        """What is wrong, the surest first."""
        return tuple(sorted(self._findings.values(), key=lambda each: (-each.confidence, each.cell)))

    @property
    def loose(self) -> BoolArray:
        """(n_cells,) joints that are loose."""
        return self._joint_watch.loose

    @property
    def resistance_age_s(self) -> float:
        """Seconds since current last showed the resistances; infinite before it did."""
        return self._joint_watch.age_s

    def step(
        self,
        time_s: float,
        dt_s: float,
        current_a: float,
        voltages_v: FloatArray,
        temperatures_degc: FloatArray,
        balancing: BoolArray | None = None,
    ) -> None:
        """Take one sample.

        Args:
            time_s: when it was measured [s].
            dt_s: since the sample before, 0 = not known [s].
            current_a: positive on discharge [A].
            voltages_v: (n_cells,) [V]; NaN = missing.
            temperatures_degc: (n_cells,) [degC]; NaN = missing.
            balancing: (n_cells,) cells that are bled; None = not known.
        """
        self._time_s = time_s
        self._joint_watch.step(dt_s, current_a, voltages_v)

    def judge(self) -> tuple[CellFinding, ...]:
        """Return what is wrong now, the surest first: also what was found before and nothing has contradicted."""
        self.joints = report = self._joint_watch.judge()
        self._keep("joint-grown", self._grown_joints(report))
        return self.findings

    def _keep(self, code: str, found: list[CellFinding]) -> None:
        """Put what was found of a kind in the place of what was known of it; a finding keeps when it began."""
        before = {cell: each for (kind, cell), each in self._findings.items() if kind == code}
        for cell in before:
            del self._findings[code, cell]  # type: ignore[arg-type]
        for each in found:
            since_s = before[each.cell].since_s if each.cell in before else each.since_s
            self._findings[each.code, each.cell] = replace(each, since_s=since_s)

    def _grown_joints(self, report: JointReport) -> list[CellFinding]:
        watch = self._joint_watch
        found = []
        known = report.resistance_ohm[np.isfinite(report.resistance_ohm)]
        usual = float(np.median(known)) if known.size else float("nan")
        for cell in np.flatnonzero(watch.loose).tolist():
            before = self._findings.get(("joint-grown", cell))
            if not np.isfinite(watch.age_s) and before is not None:
                found.append(before)  # of an earlier session: nothing has been seen since
                continue
            size = float(report.joint_excess_ohm[cell])
            sigma = float(np.linalg.norm((report.sigma_ohm[cell], watch.change_ohm[cell], SIGMA_MIN_FRAC * size)))
            seen_s = self._time_s - watch.age_s
            found.append(
                CellFinding(
                    "joint-grown",
                    cell,
                    size,
                    sigma,
                    "ohm",
                    seen_s,
                    seen_s,
                    watch.evidence_s,
                    watch.excitation_a,
                    float(report.resistance_ohm[cell]),
                    usual,
                    self._neighbours(cell),
                    confidence_of(size, sigma, ALARM_OHM),
                )
            )
        return found

    def _neighbours(self, cell: int) -> tuple[int, ...]:
        first = cell - cell % self._cells_per_pack
        return tuple(other for other in range(first, first + self._cells_per_pack) if other != cell)
