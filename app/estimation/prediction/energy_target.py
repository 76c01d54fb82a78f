"""Energy a lap that reaches the end of a race with a chosen reserve, and how the lap that is driven compares.

The target is worked out where a lap begins and stays until the next: a driver cannot follow a number that moves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from app.estimation.prediction.energy import EnergyLeft
from app.estimation.prediction.laps import PERIOD_S, LapSource, LapWatch

PACE_ROUNDS: Final = 3  # what a slower lap saves of the losses is a few percent of it: the second round is exact enough
PACE_RANGE: Final = (0.3, 2.0)  # share of the energy of the laps driven that losses are computed for


@dataclass(frozen=True)
class RacePlan:
    """The crew's plan of a race.

    Attributes:
        laps_to_go: the one that is driven included.
        reserve_soc: of the first cell to be empty, at the end, 0..1.
    """

    laps_to_go: int
    reserve_soc: float


@dataclass(frozen=True)
class EnergyTarget:
    """Energy that a lap may take.

    Attributes:
        laps_to_go: the one that is driven included; 0: all are driven.
        reserve_soc: of the first cell to be empty, at the end.
        lap_energy_wh: each of them, so that the reserve is left; None where none is to go [Wh].
        low_wh: lower end of its band [Wh].
        high_wh: upper end [Wh].
        used_wh: of this lap up to now [Wh].
        expected_wh: what of the target is usual by now, by the laps before; None before they are known [Wh].
        last_lap_wh: of the lap before, None without one [Wh].
        counted_by: what counts the laps; None before anything does.
    """

    laps_to_go: int
    reserve_soc: float
    lap_energy_wh: float | None
    low_wh: float | None
    high_wh: float | None
    used_wh: float
    expected_wh: float | None
    last_lap_wh: float | None
    counted_by: LapSource | None


class EnergyTargetStore:
    """Counts the laps of a plan down and keeps the target of the lap that is driven."""

    def __init__(self) -> None:
        self._plan: RacePlan | None = None
        self._laps_to_go = 0
        self._line = (0.0, 0.0)  # where this lap began: driving time [s] and energy [Wh]
        self._marks = 0  # that were looked at
        self._counted_by: LapSource | None = None
        self._last_lap_wh: float | None = None
        self._target: tuple[float, float, float] | None = None  # this lap, low and high [Wh]

    def set(self, plan: RacePlan | None, watch: LapWatch) -> None:
        """Begin with a plan, or end without one; a line that was crossed lately is where the present lap began."""
        self._plan, self._target, self._last_lap_wh, self._counted_by = plan, None, None, None
        self._laps_to_go = 0 if plan is None else plan.laps_to_go
        self._marks, mark = watch.last_mark
        self._line = watch.now
        if mark is not None and self._line[0] - mark[0] < PERIOD_S[1]:
            self._line, self._counted_by = mark, "marks"

    def judge(self, watch: LapWatch, energy_to: Callable[[float, float], EnergyLeft]) -> EnergyTarget | None:
        """Return the target, None without a plan.

        Args:
            watch: the laps.
            energy_to: what is left [Wh] until the first cell is at a SOC, at so many times the load driven up to now.
        """
        if self._plan is None:
            return None
        self._count(watch)
        now_s, now_wh = watch.now
        used_wh = now_wh - self._line[1]
        if self._target is None and self._laps_to_go > 0:
            self._target = self._lap_energies(used_wh, watch, energy_to)
        middle, low, high = self._target or (None, None, None)
        share = watch.share_of_lap(self._line[0], now_s)
        return EnergyTarget(
            laps_to_go=self._laps_to_go,
            reserve_soc=self._plan.reserve_soc,
            lap_energy_wh=middle,
            low_wh=low,
            high_wh=high,
            used_wh=used_wh,
            expected_wh=None if middle is None or share is None else share * middle,
            last_lap_wh=self._last_lap_wh,
            counted_by=self._counted_by,
        )

    def _count(self, watch: LapWatch) -> None:
        marks, mark = watch.last_mark
        if marks != self._marks and mark is not None:
            self._counted_by = "marks"
            n_laps, self._marks = marks - self._marks, marks
            if mark[0] - self._line[0] >= PERIOD_S[0]:  # less is no lap: the start, or pressed twice
                self._cross(mark, n_laps)
            else:
                self._line, self._target = mark, None
        elif self._counted_by != "marks" and watch.laps is not None and watch.laps.source == "period":
            self._counted_by = "period"
            while watch.now[0] - self._line[0] >= watch.laps.period_s:
                at_s = self._line[0] + watch.laps.period_s
                self._cross((at_s, watch.energy_at(at_s)), 1)

    def _cross(self, line: tuple[float, float], n_laps: int) -> None:
        self._last_lap_wh = (line[1] - self._line[1]) / n_laps
        self._laps_to_go = max(self._laps_to_go - n_laps, 0)
        self._line, self._target = line, None

    def _lap_energies(
        self, used_wh: float, watch: LapWatch, energy_to: Callable[[float, float], EnergyLeft]
    ) -> tuple[float, float, float]:
        """Return the target and its band: what was left at the line over the laps to go, driven at that pace [Wh]."""
        assert self._plan is not None
        lap_wh = None if watch.laps is None else float(watch.laps.energies_wh.mean())
        pace = 1.0
        for _ in range(PACE_ROUNDS):
            left = energy_to(self._plan.reserve_soc, pace)
            target_wh = (left.energy_wh + used_wh) / self._laps_to_go
            if not lap_wh or lap_wh <= 0.0:
                break
            pace = min(max(target_wh / lap_wh, PACE_RANGE[0]), PACE_RANGE[1])
        low, high = ((wh + used_wh) / self._laps_to_go for wh in (left.low_wh, left.high_wh))
        return target_wh, low, high
