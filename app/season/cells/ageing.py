"""Capacity or resistance of each cell over time and throughput: a Gaussian process, with bands, also ahead.

    y(t, q) = m + a t + b q + c sqrt(t) + d sqrt(q) + g(t, q) + noise

t and q are time and throughput over those of the whole season, m to d normal with standard deviations that all cells
share, g a Matern process of order 3/2 for what lines and roots do not follow. The shared standard deviations are those
of the largest marginal likelihood over all cells; the band is of the true value, without the noise of measuring it.
Source: Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), chapters 2 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray

LEAST: Final = 6  # measurements of a cell
REACH: Final = 0.6  # over which the Matern process forgets, of the season
FIT_CELLS: Final = 24  # for the shared standard deviations
GRID: Final = 10.0 ** np.linspace(-4.0, 0.0, 17)  # of what is measured, a fraction of new
LEAST_SCALES: Final = (0.02, 0.02, 0.02, 0.02, 0.02, 0.003, 1e-4)  # no way of ageing is ever ruled out
ROUNDS: Final = 3
MISSING_SIGMA: Final = 1e3
_START: Final = (0.05, 0.03, 0.03, 0.03, 0.03, 0.003, 0.003)


@dataclass(frozen=True)
class Ageing:
    """(m, n_cells) mean and standard deviation at the asked times; NaN of a cell that too little is known of."""

    mean: FloatArray
    sigma: FloatArray

    @property
    def low(self) -> FloatArray:
        """Lower end of the band of 95 %."""
        return np.asarray(self.mean - 1.959964 * self.sigma)

    @property
    def high(self) -> FloatArray:
        """Upper end of the band of 95 %."""
        return np.asarray(self.mean + 1.959964 * self.sigma)


def ageing(
    days: FloatArray,
    throughput: FloatArray,
    values: FloatArray,
    sigmas: FloatArray,
    at_days: FloatArray,
    at_throughput: FloatArray,
) -> Ageing:
    """Return what (n, n_cells) measurements say at other times, of the past or ahead.

    Args:
        days: (n,) since the first session, rising.
        throughput: (n,) charge so far, in any unit.
        values: fractions of new, NaN where not measured.
        sigmas: their standard deviations.
        at_days: (m,) asked times.
        at_throughput: (m,) charge by then.
    """
    spans = max(float(days[-1]), 1e-9), max(float(throughput[-1]), 1e-9)
    seen = np.stack((days / spans[0], throughput / spans[1]), axis=1)
    asked = np.stack((at_days / spans[0], at_throughput / spans[1]), axis=1)
    known = np.isfinite(values) & np.isfinite(sigmas)
    enough = known.sum(axis=0) >= LEAST
    mean = np.full((len(at_days), values.shape[1]), np.nan)
    sigma = mean.copy()
    if not enough.any():
        return Ageing(mean, sigma)
    level = np.nanmean(np.where(known, values, np.nan)[:, enough])
    y = np.where(known, values - level, 0.0)[:, enough].T
    noise2 = np.where(known, sigmas, MISSING_SIGMA)[:, enough].T ** 2
    scales = _scales(seen, y, noise2)
    found = _predict(seen, asked, y, noise2 + np.where(known[:, enough].T, scales[-1] ** 2, 0.0), scales)
    mean[:, enough], sigma[:, enough] = level + found[0], found[1]
    return Ageing(mean, sigma)


def _parts(a: FloatArray, b: FloatArray) -> list[FloatArray]:
    """The covariances of the terms for scales of 1, (len(a), len(b)) each."""
    root_a, root_b = np.sqrt(np.maximum(a, 0.0)), np.sqrt(np.maximum(b, 0.0))
    apart = np.sqrt(3.0) / REACH * np.linalg.norm(a[:, None] - b[None], axis=2)
    products = [np.outer(x[:, k], y[:, k]) for x, y in ((a, b), (root_a, root_b)) for k in (0, 1)]
    return [np.ones((len(a), len(b))), *products, (1.0 + apart) * np.exp(-apart)]


def _kernel(parts: list[FloatArray], scales: FloatArray) -> FloatArray:
    total = np.zeros_like(parts[0])
    for scale, part in zip(scales, parts, strict=False):  # the last scale is the noise's
        total += scale**2 * part
    return total


def _scales(seen: FloatArray, y: FloatArray, noise2: FloatArray) -> FloatArray:
    """The shared standard deviations, one after the other on a grid."""
    parts = _parts(seen, seen)
    chosen = np.linspace(0, len(y) - 1, min(len(y), FIT_CELLS)).round().astype(int)
    y, noise2 = y[chosen], noise2[chosen]
    is_known = noise2 < MISSING_SIGMA**2
    scales = np.array(_START)

    def likelihood(trial: FloatArray) -> float:
        cov = _kernel(parts, trial)[None] + _diagonal(noise2 + is_known * trial[-1] ** 2)
        root = np.linalg.cholesky(cov)
        white = np.linalg.solve(root, y[:, :, None])[:, :, 0]
        return float(-0.5 * (white**2).sum() - np.log(np.diagonal(root, axis1=1, axis2=2)).sum())

    for _ in range(ROUNDS):
        for k in range(len(scales)):
            grid = GRID[LEAST_SCALES[k] <= GRID]
            trials = np.repeat(scales[None], len(grid), axis=0)
            trials[:, k] = grid
            scales = trials[int(np.argmax([likelihood(trial) for trial in trials]))]
    return scales


def _predict(
    seen: FloatArray, asked: FloatArray, y: FloatArray, noise2: FloatArray, scales: FloatArray
) -> tuple[FloatArray, FloatArray]:
    cov = _kernel(_parts(seen, seen), scales)[None] + _diagonal(noise2)
    across = _kernel(_parts(seen, asked), scales)
    own = sum(scale**2 * np.diagonal(part) for scale, part in zip(scales, _parts(asked, asked), strict=False))
    root = np.linalg.cholesky(cov)
    white = np.linalg.solve(root, y[:, :, None])[:, :, 0]
    reached = np.linalg.solve(root, np.broadcast_to(across, (len(y), *across.shape)))
    mean = np.einsum("cnm,cn->mc", reached, white)
    variance = np.maximum(np.asarray(own)[:, None] - (reached**2).sum(axis=1).T, 0.0)
    return mean, np.sqrt(variance)


def _diagonal(values: FloatArray) -> FloatArray:
    made = np.zeros((*values.shape, values.shape[1]))
    index = np.arange(values.shape[1])
    made[:, index, index] = values + 1e-12
    return made
