"""Fits of every possible fault to one cell's voltage: least squares, onset and size searched.

The cell is compared with the median cell, which carries the same current. The noise is what healthy cells differ by.
Every model is: nothing until an onset, then its own law with one size.

    joint        apart = -R i
    resistance   apart = -R (i + sum_j r_j slow i_j / r_0)       the polarisation grows with it: see `_grown`
    capacity     apart = U(soc - x used) - U(soc)           charge used counts more by the share x
    leak         apart = U(soc - I t / Q) - U(soc)          charge leaves by itself
    stuck        voltage = constant
    lower        apart = U(soc - d) - U(soc)                it began with less charge
    warm         apart = r i, less resistance of a cell that is warmer; capacity and leak may have it, too

U(soc) is the voltage at the recorded current: an emptier cell has less OCV and resists more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.health.cell_voltages import CellVoltage, UnderLoad, resistances, slow_current

Law = Literal["joint", "resistance", "capacity", "leak", "stuck", "warm", "lower"]
LeakHeat = Callable[[FloatArray, float], FloatArray]
_Likelihood = Callable[[FloatArray], FloatArray]  # likelihood over sizes
ONSETS: Final = 48
CORRELATED: Final = 0.1  # independent values a sample: errors of one second are alike
MOST_INDEPENDENT: Final = 15.0  # values of a stretch: drifts of healthy cells last as long as it does
HEALTHY_OHM: Final = 2.5e-4  # by which sound cells and joints differ
WARM_OHM: Final = 8e-4  # resistance of a cell of 2 mohm, from 25 to 60 degC
STUCK_V: Final = 1.5e-3
CAPACITY_SIZES: Final = np.geomspace(0.05, 4.0, 24)
HEALTHY_SPREAD: Final = 0.015  # spread of the charge that cells begin with
SPREAD_SIZES: Final = np.linspace(-HEALTHY_SPREAD, HEALTHY_SPREAD, 13)
LOWER_SIZES: Final = np.geomspace(0.02, 0.3, 16)
FINER, FINER_POINTS = 2, 7  # searches around the best of a grid: a grid's steps cost more than laws differ by
LEAK_SIZES_A: Final = np.geomspace(0.5, 60.0, 28)
ZERO_A: Final = 0.5  # current of the current sensor, at most: a large joint shows it as a voltage
SIZE_SHARE: Final = 0.05  # share of a size: the model's error, which more samples do not take away
RARER: Final = 2.0  # log odds of a cell that resists more against a joint: within a second they look alike
GROWN_TURNS: Final = 2  # from its size to how slow it is, and back
STEP_SHARE: Final = 0.05  # share of a size, by which the likelihood's curvature is taken


@dataclass(frozen=True)
class CellFit:
    """One law against one cell's voltage: log of the likelihood, size [ohm, share, A or V], since when, its sigma."""

    law: Law
    log_likelihood: float
    size: float
    onset_s: float
    sigma: float = float("nan")  # sigma of the size; NaN: it has none


def fit_cell(cell: CellVoltage, model: CellModel, leak_heat: LeakHeat) -> list[CellFit]:
    """Return every law's best fit, in no order.

    The log likelihood is against nothing being wrong with the cell. `leak_heat` gives that of the temperature for
    leaks [A] since an onset, which counts where the leak's size and onset are searched.
    """
    under_load = UnderLoad(cell, model)
    spread, *_ = _lower(cell, under_load, SPREAD_SIZES)
    healthy = max(float(_warm_likelihood(cell, cell.deviation_v, HEALTHY_OHM)), spread)
    onsets = _onsets(cell)
    fits: list[CellFit | None] = [
        _best("joint", _drops(cell, cell.current_a, onsets), healthy),
        _best("resistance", _grown(cell, model, onsets), healthy),
    ]
    fits.append(CellFit("warm", float(_warm_likelihood(cell, cell.deviation_v)) - healthy, 0.0, float(cell.time_s[0])))
    charges: tuple[tuple[Law, _Candidate], ...] = (
        ("capacity", _capacity(cell, under_load)),
        ("lower", _lower(cell, under_load, LOWER_SIZES)),
        ("leak", _leak(cell, model, under_load, onsets, leak_heat)),
    )
    fits += [CellFit(law, likelihood - healthy, *rest) for law, (likelihood, *rest) in charges]
    fits.append(_stuck(cell))
    return [fit for fit in fits if fit is not None]


_Candidate = tuple[float, float, float, float]  # log likelihood, size, onset, sigma of the size


def _best(law: Law, candidates: Iterator[_Candidate], healthy: float) -> CellFit | None:
    best = max(candidates, default=None)
    return None if best is None else CellFit(law, best[0] - healthy, *best[1:])


def _onsets(cell: CellVoltage) -> FloatArray:
    """Times since which it may be so: the beginning, and closer and closer towards the instant that is asked about."""
    before_s = max(cell.around_s - cell.time_s[0], 1.0)
    back = np.geomspace(0.2, before_s, ONSETS - 1)
    return np.unique(np.concatenate(([cell.time_s[0]], cell.around_s - back)))


def _residual(deviation_v: FloatArray, cell: CellVoltage) -> FloatArray:
    """What is left of a deviation without a constant one, by weighted least squares."""
    weight = 1.0 / cell.noise_v**2
    residual: FloatArray = deviation_v - (weight * deviation_v).sum(axis=-1, keepdims=True) / weight.sum()
    return residual


def _log_likelihood(cell: CellVoltage, residual_v: FloatArray) -> FloatArray:
    """Gaussian with broad shoulders: no single sample decides. One for each row of residuals."""
    ratio = (residual_v / cell.noise_v) ** 2
    return np.asarray(-0.5 * _share(ratio.shape[-1]) * (25.0 * np.log1p(ratio / 25.0)).sum(axis=-1))


def _share(n: int) -> float:
    """Independent values a sample, of n samples."""
    return min(CORRELATED, MOST_INDEPENDENT / n)


def _with_model(sigma: float, size: float) -> float:
    """The standard deviation of a size with what the model itself is wrong by."""
    return float(np.hypot(sigma, SIZE_SHARE * size))


def _sigma_at(likelihood: _Likelihood, size: float, best: float) -> float:
    """The standard deviation of a size, by how the log likelihood falls to either side of its maximum."""
    step = STEP_SHARE * abs(size)
    fall = best - float(likelihood(np.array([size - step, size + step])).mean())
    return _with_model(step / float(np.sqrt(2.0 * fall)) if fall > 0.0 else abs(size), size)


def _warm_likelihood(cell: CellVoltage, deviation_v: FloatArray, most_ohm: float = WARM_OHM) -> FloatArray:
    """As `_log_likelihood`, with the resistance that fits: a little more, or less up to what warmth takes away."""
    weight = 1.0 / cell.noise_v**2
    x = cell.current_a - (weight * cell.current_a).sum() / weight.sum()
    y = _residual(deviation_v, cell)
    square = (weight * x * x).sum()
    less = np.clip((weight * x * y).sum(axis=-1, keepdims=True) / max(square, 1e-9), -HEALTHY_OHM, most_ohm)
    return _log_likelihood(cell, y - less * x)


def _drops(cell: CellVoltage, drop_a: FloatArray, onsets: FloatArray) -> Iterator[_Candidate]:
    weight = 1.0 / cell.noise_v**2
    y = _residual(cell.deviation_v, cell)
    for onset_s in onsets:
        since = np.where(cell.time_s >= onset_s, 1.0, 0.0)
        x = _residual(-drop_a * since, cell)
        square = (weight * x * x).sum()
        if square <= 0.0:
            continue
        size = float((weight * x * y).sum() / square)
        if size > 0.0:
            y_zero = y - _zero_drop(cell, y - size * x, ZERO_A * size, _residual(since, cell))
            size = float((weight * x * y_zero).sum() / square)
            sigma = _with_model(float(1.0 / np.sqrt(_share(len(x)) * square)), size)
            yield float(_log_likelihood(cell, y_zero - size * x)), size, float(onset_s), sigma


def _grown(cell: CellVoltage, model: CellModel, onsets: FloatArray) -> Iterator[_Candidate]:
    """A cell that resists k times as much: its RC pairs keep their capacitance, and are k times as slow.

    What it drops more than another, w = v - u, of a pair with u = R i_j:

        u' = (R i - u) / (R C),  v' = (k R i - v) / (k R C)
        w' = ((k - 1) u - w) / (k R C),  so w = (k - 1) R slow(i_j), 0 at the onset
    """
    usual_ohm, lagged_ohm = resistances(model)
    lags = [(float(ohm) / usual_ohm, float(tau_s.mean())) for ohm, tau_s in zip(lagged_ohm, model.tau_s, strict=True)]
    for onset_s in onsets:
        since = cell.time_s >= onset_s
        candidate = next(_drops(cell, cell.current_a, np.array([onset_s])), None)
        for _ in range(GROWN_TURNS):
            if candidate is None:
                break
            drop_a, times = cell.current_a.copy(), 1.0 + candidate[1] / usual_ohm
            for (share, tau_s), branch_a in zip(lags, cell.branch_a, strict=True):
                drop_a[since] += share * slow_current(cell.time_s[since], branch_a[since], times * tau_s)
            candidate = next(_drops(cell, drop_a, np.array([onset_s])), None)
        if candidate is not None:
            yield candidate[0] - RARER, *candidate[1:]


def _zero_drop(cell: CellVoltage, left_v: FloatArray, most_v: float, since: FloatArray) -> FloatArray:
    """What is left of a drop because the current sensor has a zero of its own."""
    weight = 1.0 / cell.noise_v**2
    square = (weight * since * since).sum()
    level = (weight * since * left_v).sum() / square if square > 0.0 else 0.0
    drop: FloatArray = float(np.clip(level, -most_v, most_v)) * since
    return drop


def _capacity(cell: CellVoltage, under_load: UnderLoad) -> _Candidate:
    def likelihood(sizes: FloatArray) -> FloatArray:
        return _warm_likelihood(cell, cell.deviation_v - under_load.moved_v(cell.soc - sizes[:, None] * cell.used))

    best, size = _largest(likelihood, CAPACITY_SIZES)
    return best, size, float(cell.time_s[0]), _sigma_at(likelihood, size, best)


def _lower(cell: CellVoltage, under_load: UnderLoad, sizes: FloatArray) -> _Candidate:
    def likelihood(sizes: FloatArray) -> FloatArray:
        return _log_likelihood(cell, cell.deviation_v - under_load.moved_v(cell.soc - sizes[:, None]))

    best, size = _largest(likelihood, sizes)
    return best, size, float(cell.time_s[0]), _sigma_at(likelihood, size, best)


def _leak(
    cell: CellVoltage,
    model: CellModel,
    under_load: UnderLoad,
    onsets: FloatArray,
    heat: LeakHeat,
) -> _Candidate:
    """The size is searched with the heat that it makes."""
    capacity_coulomb = SECONDS_PER_HOUR * model.capacity_ah

    def likelihood(sizes: FloatArray, onset_s: float) -> FloatArray:
        ago_s = np.maximum(cell.time_s - onset_s, 0.0)
        moved = under_load.moved_v(cell.soc - sizes[:, None] * ago_s / capacity_coulomb)
        return _warm_likelihood(cell, cell.deviation_v - moved)

    def with_heat(sizes: FloatArray, onset_s: float) -> FloatArray:
        return likelihood(sizes, onset_s) + heat(sizes, onset_s)

    _, onset_s = max((float(with_heat(LEAK_SIZES_A, onset_s).max()), onset_s) for onset_s in onsets[::2].tolist())
    best, size = _largest(lambda sizes: with_heat(sizes, onset_s), LEAK_SIZES_A)
    sigma = _sigma_at(lambda sizes: with_heat(sizes, onset_s), size, best)
    return float(likelihood(np.array([size]), onset_s)[0]), size, onset_s, sigma


def _largest(likelihood: _Likelihood, sizes: FloatArray) -> tuple[float, float]:
    """Return the largest value and where it is: on a grid, then closer around the best of it."""
    likelihoods = likelihood(sizes)
    for _ in range(FINER):
        best = int(likelihoods.argmax())
        sizes = np.linspace(sizes[max(best - 1, 0)], sizes[min(best + 1, len(sizes) - 1)], FINER_POINTS)
        likelihoods = likelihood(sizes)
    best = int(likelihoods.argmax())
    return float(likelihoods[best]), float(sizes[best])


def _stuck(cell: CellVoltage) -> CellFit | None:
    """The voltage stands still to the end although the others move."""
    held = float(cell.voltage_v[-1])
    moving = np.flatnonzero(np.abs(cell.voltage_v - held) > STUCK_V)
    first = int(moving[-1]) + 1 if moving.size else 0
    after = slice(first, None)
    if len(cell.voltage_v) - first < 8 or np.ptp(cell.median_v[after]) < 4 * STUCK_V:
        return None
    healthy = float(_warm_likelihood(cell, cell.deviation_v, HEALTHY_OHM))
    before = cell.deviation_v[:first]
    level = float(np.median(before)) if first else 0.0
    residual = np.concatenate((before - level, cell.voltage_v[after] - held))
    return CellFit("stuck", float(_log_likelihood(cell, residual)) - healthy, held, float(cell.time_s[first]))
