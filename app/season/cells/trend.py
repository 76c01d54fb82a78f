"""A straight line over time with its band, and where it steps: what a season says of one quantity of each cell.

    y_k = a + b t_k + e_k,   var e_k = s_k^2 + u^2

s_k is what was measured with it, u what differs from session to session beyond that: u is chosen so that the residuals
are as large as their degrees of freedom demand. Bands are Student's, widened where residuals repeat the one before.

A step is looked for after every session but the first and last `EDGE`, beside a line that may bend as the root and the
square of time do, because what ages does: its score is the largest squared t over all places, less by how residuals
repeat the one before, its significance how often such a line without any step reaches it, drawn `DRAWS` times at the
same times with the same weights. Of many cells the p-values are Holm's.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc, sqrt
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray

Z95: Final = 1.959964
FEW_FREEDOM: Final = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0)
FEW_95: Final = (12.7063, 8.0280, 6.0167, 4.3027, 3.5747, 3.1825)  # the 97.5 % quantiles of t
LEAST: Final = 5  # sessions for a line
EDGE: Final = 4  # sessions on either side of a step
DRAWS: Final = 4999
STEP_P_MAX: Final = 0.05
STEP_PARAMETERS: Final = 5  # of a line, its two bends and a step
DRAWN_P_MAX: Final = 0.3  # above, by the sum over all places, nothing is drawn
MOST_STEPS: Final = 60  # until the squares are right; a few are enough
SQUARES_OFF: Final = 1e-9  # of them


@dataclass(frozen=True)
class Line:
    """Per day, with the ends of its band of 95 %; `now` is the line at the last session."""

    per_day: float
    low: float
    high: float
    now: float
    now_sigma: float
    n: int

    @property
    def is_sure(self) -> bool:
        """Whether the band leaves out that nothing changes."""
        return self.low > 0.0 or self.high < 0.0


@dataclass(frozen=True)
class Step:
    """From session `at` on (an index) the values lie higher by `size`, with its band; `p` after all cells' tests."""

    at: int
    size: float
    low: float
    high: float
    p: float


def student_95(freedom: float) -> float:
    """Return the 97.5 % quantile of Student's t, expanded about the normal (Abramowitz 26.7.5); below 3 of a table."""
    if freedom < FEW_FREEDOM[-1]:
        return float(np.interp(freedom, FEW_FREEDOM, FEW_95))  # between two of them no less than the true one
    z, v = Z95, freedom
    terms = (z**3 + z) / 4 / v, (5 * z**5 + 16 * z**3 + 3 * z) / 96 / v**2
    last = (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384 / v**3
    return float(z + sum(terms) + last)


def student_p(t2: float, freedom: float) -> float:
    """Return how often the square of Student's t is above `t2` by chance (Wallace 1959): rather too often."""
    z = sqrt(freedom * np.log1p(t2 / freedom)) * (8 * freedom + 1) / (8 * freedom + 3)
    return erfc(z / sqrt(2.0))


def line(days: FloatArray, values: FloatArray, sigmas: FloatArray) -> Line | None:
    """Return the line through (n,) values, NaN where there is none; None with fewer than LEAST, or all at once."""
    known = np.isfinite(values) & np.isfinite(sigmas)
    days, values, sigmas = days[known], values[known], sigmas[known]
    if len(values) < LEAST or days[-1] <= days[0]:
        return None
    design = np.stack((np.ones_like(days), days - days[-1]), axis=1)
    weights, inverse, best, residual = _fit(design, values, sigmas)
    freedom = len(values) - 2
    white = residual * np.sqrt(weights)
    repeats = float(white[1:] @ white[:-1]) / max(float(white @ white), 1e-300)
    repeats = min(max(repeats, 0.0), 0.9)
    widen = np.sqrt((1.0 + repeats) / (1.0 - repeats))
    now_sigma, slope_sigma = np.sqrt(np.diag(inverse)) * widen
    reach = student_95(freedom) * slope_sigma
    return Line(
        float(best[1]), float(best[1] - reach), float(best[1] + reach), float(best[0]), float(now_sigma), len(values)
    )


def lines(days: FloatArray, values: FloatArray, sigmas: FloatArray) -> list[Line | None]:
    """Return the line of each column of (n, cells) values."""
    return [line(days, values[:, k], sigmas[:, k]) for k in range(values.shape[1])]


def steps(days: FloatArray, values: FloatArray, sigmas: FloatArray, seed: int = 0) -> list[Step | None]:
    """Return for each column of (n, cells) values its step where the test supports one."""
    n_cells = values.shape[1]
    found: list[Step | None] = [None] * n_cells
    drawn: dict[bytes, FloatArray] = {}
    p = np.ones(n_cells)
    for k in range(n_cells):
        known = np.isfinite(values[:, k]) & np.isfinite(sigmas[:, k])
        rows = np.flatnonzero(known)
        if len(rows) < 2 * EDGE + 2:
            continue
        weights, _, _, residual = _fit(_bent(days[rows]), values[rows, k], sigmas[rows, k])
        key = rows.tobytes() + np.round(weights / weights.max(), 2).tobytes()
        scores = _Scores(days[rows], weights)
        t2, sizes, sizes_sigma = scores.of(residual)
        at = int(np.argmax(t2))
        more = scores.repeats(residual, at)
        t2, sizes_sigma = t2 / more, sizes_sigma * np.sqrt(more)
        if scores.at_most(t2[at]) > DRAWN_P_MAX:
            continue
        if key not in drawn:
            drawn[key] = scores.by_chance(np.random.default_rng(seed))
        p[k] = (1 + np.count_nonzero(drawn[key] >= t2[at])) / (DRAWS + 1)
        reach = student_95(len(rows) - STEP_PARAMETERS) * sizes_sigma[at]
        found[k] = Step(int(rows[scores.places[at]]), float(sizes[at]), sizes[at] - reach, sizes[at] + reach, p[k])
    adjusted = holm(p)
    return [
        Step(step.at, step.size, float(step.low), float(step.high), float(adjusted[k]))
        if step is not None and adjusted[k] < STEP_P_MAX
        else None
        for k, step in enumerate(found)
    ]


def holm(p: FloatArray) -> FloatArray:
    """Return p-values that hold for all of them together (Holm 1979)."""
    order = np.argsort(p)
    factors = np.arange(len(p), 0, -1)
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * factors), 1.0)
    return adjusted


class _Scores:
    """Squared t of a step at every place, beside a line, for weights that are given."""

    def __init__(self, days: FloatArray, weights: FloatArray) -> None:
        root = np.sqrt(weights)
        n = len(days)
        self.places = np.arange(EDGE, n - EDGE + 1)
        steps = (np.arange(n)[:, None] >= self.places).astype(np.float64) * root[:, None]
        basis, _ = np.linalg.qr(_bent(days) * root[:, None])
        self._basis, self._root = basis, root
        self._steps = steps - basis @ (basis.T @ steps)
        self._squares = np.maximum((self._steps**2).sum(axis=0), 1e-12)

    def of(self, residual: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return scores, sizes and their sigmas."""
        white = residual * self._root
        t2, projected = self._t2(white[None])
        sigma = np.sqrt((float(white @ white) - projected[0] ** 2 / self._squares) / (len(white) - STEP_PARAMETERS))
        return t2[0], projected[0] / self._squares, np.asarray(sigma / np.sqrt(self._squares))

    def repeats(self, residual: FloatArray, at: int) -> float:
        """Return by how much the variance of a step at a place is larger because what is left repeats itself.

        What is left beside the step is as good as white where there is a step, and goes up and down slowly where the
        values bend otherwise than as the root of time.
        """
        white = residual * self._root
        step = self._steps[:, at]
        white = white - step * (white @ step) / self._squares[at]
        n = len(white)
        r = float(white[1:] @ white[:-1]) / max(float(white @ white), 1e-300)
        r = min(max(r + (1.0 + STEP_PARAMETERS) / n, 0.0), 0.95)  # a fit leaves less of it than there is
        return (1.0 + r) / (1.0 - r)

    def at_most(self, t2: float) -> float:
        """Return a p-value that is no smaller than the true one: each place by itself, added up."""
        return len(self.places) * student_p(t2, len(self._root) - STEP_PARAMETERS)

    def by_chance(self, rng: np.random.Generator) -> FloatArray:
        """Return the largest scores of DRAWS lines without a step."""
        white = rng.standard_normal((DRAWS, len(self._root)))
        white -= (white @ self._basis) @ self._basis.T
        return np.asarray(self._t2(white)[0].max(axis=1))

    def _t2(self, white: FloatArray) -> tuple[FloatArray, FloatArray]:
        projected = white @ self._steps
        gained = projected**2 / self._squares
        left = np.maximum((white**2).sum(axis=1, keepdims=True) - gained, 1e-300)
        return gained / left * (white.shape[1] - STEP_PARAMETERS), projected


def _design(days: FloatArray) -> FloatArray:
    return np.stack((np.ones_like(days), days - days[-1]), axis=1)


def _bent(days: FloatArray) -> FloatArray:
    """A line, the root and the square of time: what ages bends as they do, also with the seasons, and is no step."""
    passed = days - days[0]
    return np.column_stack((_design(days), np.sqrt(passed), (passed / max(float(passed[-1]), 1e-9)) ** 2))


def _fit(
    design: FloatArray, values: FloatArray, sigmas: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Weights, inverse of the normal matrix, parameters, residuals; what sessions differ by is found by Newton's steps.

    That is the variance `more` at which the weighted squares of the residuals add up to their degrees of freedom. They
    fall as it grows, for equal sigmas as 1/(sigma^2 + more), so it is their inverse that steps are taken on.
    """
    freedom = len(values) - design.shape[1]
    more, low, high = 0.0, 0.0, float(np.var(values)) + 1e-18
    for step in range(MOST_STEPS):
        weights = 1.0 / (sigmas**2 + more + 1e-18)
        inverse = np.asarray(np.linalg.inv(design.T @ (weights[:, None] * design)), dtype=np.float64)
        best = inverse @ (design.T @ (weights * values))
        residual = values - design @ best
        white2 = weights * residual**2
        squares = float(white2.sum())
        if squares <= freedom * (1.0 + SQUARES_OFF) and (step == 0 or squares >= freedom * (1.0 - SQUARES_OFF)):
            break
        low, high = (more, high) if squares > freedom else (low, more)
        more += squares * (squares / freedom - 1.0) / float(weights @ white2)
        if not low <= more <= high:
            more = 0.5 * (low + high)
    return weights, inverse, best, residual
