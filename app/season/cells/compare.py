"""Two groups of sessions against each other: two cars, two halves of a season, before and after a change.

Sessions of one group differ among themselves, by weather and by driver, so a difference is judged by the spread between
sessions, never between the cells of one: Welch's t of the sessions' medians. Two cars are compared as two accumulators;
groups that hold more are compared car by car, because sessions of two cars make no series. Cells are compared within a
car: their p-values are Holm's, and only the modules of today count. Self-discharge is that of the pause before a
session; it counts where the session before the pause is of the same group, because of a pause between the groups nobody
knows which one it belongs to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.season.cells.history import CellHistory, row_median
from app.season.cells.trend import holm, student_95, student_p

LEAST: Final = 2  # sessions of each group
P_MAX: Final = 0.05
UNITS: Final = {
    "resistance": "1",
    "resistance_spread": "1",
    "capacity": "Ah",
    "capacity_spread": "Ah",
    "self_discharge": "1/d",
    "self_discharge_spread": "1/d",
    "temperature": "degC",
    "temperature_spread": "K",
}


@dataclass(frozen=True)
class SeasonDifference:
    """`b` less `a` of one figure, with the ends of its band of 95 %; None where a group has fewer than two."""

    name: str
    unit: str
    a: float | None
    b: float | None
    n_a: int
    n_b: int
    change: float | None
    low: float | None
    high: float | None

    @property
    def is_sure(self) -> bool:
        """Whether the band leaves out that nothing changed."""
        return self.low is not None and self.high is not None and (self.low > 0.0 or self.high < 0.0)


@dataclass(frozen=True)
class SeasonCellDifference:
    """A cell that changed against the others of its car; `p` after the tests of all cells."""

    cell: int
    change: float
    low: float
    high: float
    p: float


@dataclass(frozen=True)
class CarComparison:
    """Group B, sessions of `car_b`, against group A, sessions of `car_a`; `cells` where that is the same car."""

    car_a: str
    car_b: str
    sessions_a: int
    sessions_b: int
    differences: list[SeasonDifference]
    cells: list[SeasonCellDifference]


def compare(histories: Sequence[CellHistory], a: set[str], b: set[str]) -> list[CarComparison]:
    """Return how group `b` of sessions differs from group `a`: of two cars, or of each car that has sessions in one."""
    of_a, of_b = ([history for history in histories if group & {*history.sessions}] for group in (a, b))
    if len(of_a) == len(of_b) == 1:
        return [_compared(of_a[0], of_b[0], a, b)]
    return [_compared(history, history, a, b) for history in histories if history in of_a or history in of_b]


def _compared(first: CellHistory, second: CellHistory, a: set[str], b: set[str]) -> CarComparison:
    before, after = _figures(first, a), _figures(second, b)
    if not (first.is_absolute and second.is_absolute):
        before["resistance"], after["resistance"] = np.empty(0), np.empty(0)
    return CarComparison(
        first.car,
        second.car,
        int(_in(first, a).sum()),
        int(_in(second, b).sum()),
        [_difference(name, UNITS[name], before[name], after[name]) for name in UNITS],
        _changed_cells(first, a, b) if first is second else [],
    )


def _in(history: CellHistory, group: set[str]) -> BoolArray:
    return np.array([session in group for session in history.sessions], dtype=bool)


def _figures(history: CellHistory, group: set[str]) -> dict[str, FloatArray]:
    """By name, (n,) what each session of a group says."""
    chosen = _in(history, group)
    is_inside = chosen & np.concatenate((chosen[:1], chosen[:-1]))
    lost = np.where(is_inside[:, None], history.lost_per_day, np.nan)
    found = {
        "resistance": row_median(history.resistance),
        "resistance_spread": _spread(history.resistance),
        "capacity": row_median(history.capacity_ah),
        "capacity_spread": _spread(history.capacity_ah),
        "self_discharge": row_median(lost),
        "self_discharge_spread": _spread(lost),
        "temperature": row_median(history.temperature_degc),
        "temperature_spread": _spread(history.temperature_degc),
    }
    return {name: values[chosen] for name, values in found.items()}


def _changed_cells(history: CellHistory, a: set[str], b: set[str]) -> list[SeasonCellDifference]:
    """Cells by their resistance against the median cell, the one that changed most first."""
    in_a, in_b = _in(history, a), _in(history, b)
    relative = np.log(history.today(history.resistance) / row_median(history.resistance)[:, None])
    cells: list[SeasonCellDifference] = []
    for cell in range(history.n_cells):
        test = _welch(*(each[np.isfinite(each)] for each in (relative[in_a, cell], relative[in_b, cell])))
        if test is not None:
            change, sigma, freedom = test
            reach = student_95(freedom) * sigma
            p = student_p(change**2 / max(sigma**2, 1e-24), freedom)
            cells.append(SeasonCellDifference(cell, change, change - reach, change + reach, p))
    adjusted = holm(np.array([each.p for each in cells]))
    sure = [replace(each, p=float(p)) for each, p in zip(cells, adjusted, strict=True) if p < P_MAX]
    return sorted(sure, key=lambda each: -abs(each.change))


def _difference(name: str, unit: str, a: FloatArray, b: FloatArray) -> SeasonDifference:
    a, b = a[np.isfinite(a)], b[np.isfinite(b)]
    means = (float(a.mean()) if a.size else None, float(b.mean()) if b.size else None)
    test = _welch(a, b)
    if test is None:
        return SeasonDifference(name, unit, *means, a.size, b.size, None, None, None)
    change, sigma, freedom = test
    reach = student_95(freedom) * sigma
    return SeasonDifference(name, unit, *means, a.size, b.size, change, change - reach, change + reach)


def _welch(a: FloatArray, b: FloatArray) -> tuple[float, float, float] | None:
    """SeasonDifference of the means, its sigma, and degrees of freedom."""
    if min(a.size, b.size) < LEAST:
        return None
    parts = np.array((a.var(ddof=1) / a.size, b.var(ddof=1) / b.size))
    total = float(parts.sum())
    freedom = total**2 / max(float((parts**2 / (a.size - 1, b.size - 1)).sum()), 1e-300)
    return float(b.mean() - a.mean()), sqrt(total), max(freedom, 1.0)


def _spread(values: FloatArray) -> FloatArray:
    found = np.full(len(values), np.nan)
    for k, row in enumerate(values):
        known = row[np.isfinite(row)]
        if known.size > 1:
            found[k] = known.std(ddof=1)
    return found
