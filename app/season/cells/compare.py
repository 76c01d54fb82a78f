"""Two groups of sessions against each other: two cars, two halves of a season, before and after a change.

Sessions of one group differ among themselves, by weather and by driver, so a difference is judged by the spread between
sessions, never between the cells of one: Welch's t of the sessions' medians. Of cells the p-values are Holm's, and only
the modules of today count. Self-discharge is that of the pause before a session; it counts where the session before the
pause is of the same group, because of a pause between the groups nobody knows which one it belongs to.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.season.cells.history import CellHistory, row_median
from app.season.cells.trend import holm, student_95, student_p

LEAST: Final = 2  # sessions of each group
P_MAX: Final = 0.05


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
    """A cell that changed against the others; `p` after the tests of all cells."""

    cell: int
    change: float
    low: float
    high: float
    p: float


def compare(
    history: CellHistory, a: set[str], b: set[str]
) -> tuple[list[SeasonDifference], list[SeasonCellDifference]]:
    """Return how group `b` of sessions differs from group `a`; cells by their resistance against the median cell."""
    in_a, in_b = (np.array([session in group for session in history.sessions], dtype=bool) for group in (a, b))
    resistance = history.resistance
    middle = row_median(resistance)
    before = history.before
    is_inside = (in_a == in_a[before]) & (in_b == in_b[before])
    lost = np.where(is_inside[:, None], history.lost_per_day, np.nan)
    figures = (
        ("resistance", "1", middle if history.is_absolute else np.full(len(middle), np.nan)),
        ("resistance_spread", "1", _spread(resistance)),
        ("capacity", "Ah", row_median(history.capacity_ah)),
        ("capacity_spread", "Ah", _spread(history.capacity_ah)),
        ("self_discharge", "1/d", row_median(lost)),
        ("self_discharge_spread", "1/d", _spread(lost)),
        ("temperature", "degC", row_median(history.temperature_degc)),
        ("temperature_spread", "K", _spread(history.temperature_degc)),
    )
    found = [_difference(name, unit, values[in_a], values[in_b]) for name, unit, values in figures]
    relative = np.log(history.today(resistance) / middle[:, None])
    cells: list[SeasonCellDifference] = []
    for cell in range(history.n_cells):
        test = _welch(*(each[np.isfinite(each)] for each in (relative[in_a, cell], relative[in_b, cell])))
        if test is not None:
            change, sigma, freedom = test
            reach = student_95(freedom) * sigma
            p = student_p(change**2 / max(sigma**2, 1e-24), freedom)
            cells.append(SeasonCellDifference(cell, change, change - reach, change + reach, p))
    adjusted = holm(np.array([each.p for each in cells]))
    sure = [
        SeasonCellDifference(each.cell, each.change, each.low, each.high, float(p))
        for each, p in zip(cells, adjusted, strict=True)
        if p < P_MAX
    ]
    return found, sorted(sure, key=lambda each: -abs(each.change))


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
