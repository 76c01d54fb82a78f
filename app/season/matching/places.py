"""Which module where, and what a string loses with a module: both of what limits a string.

Modules in series carry the same current, so order changes neither capacity nor resistance of the whole; it changes
temperature. A module heats by its resistance, a place by how it is cooled. The hottest module is coolest where the one
that heats least sits at the hottest place, the next at the next: exchanging any two of them makes the hotter one
hotter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray

DRAWS = 2000
BAND = (0.025, 0.5, 0.975)


@dataclass(frozen=True)
class Placing:
    """`module_at` is (n,) which module goes to each place; hottest and spread [K] of now and after."""

    module_at: NDArray[np.intp]
    hottest_now_k: float
    hottest_k: float
    spread_now_k: float
    spread_k: float


def place(heat_k: FloatArray, place_k: FloatArray) -> Placing:
    """Return the best placing.

    Args:
        heat_k: (n,) by how much each module heats itself beyond the mean [K].
        place_k: (n,) by how much each place is hotter than the mean [K].
    """
    module_at = np.empty(heat_k.size, dtype=np.intp)
    module_at[np.argsort(-place_k, kind="stable")] = np.argsort(heat_k, kind="stable")
    now, after = heat_k + place_k, heat_k[module_at] + place_k
    return Placing(module_at, float(now.max()), float(after.max()), float(np.ptp(now)), float(np.ptp(after)))


@dataclass(frozen=True)
class WithoutModule:
    """A string without some modules against the whole one, with the ends of its band of 95 %.

    Attributes:
        removed: which.
        capacity_ah: what the string gives before its first module is empty, now and then.
        energy: of the string, then over now (fewer modules, each used further).
        weakest_voltage_v: of the weakest module at the current that was asked, then less now [V].
        limiting: the module that is empty first, then.
    """

    removed: tuple[int, ...]
    capacity_now_ah: float
    capacity_ah: float
    capacity_low_ah: float
    capacity_high_ah: float
    energy: float
    energy_low: float
    energy_high: float
    weakest_voltage_v: float
    limiting: int


def without(
    removed: Sequence[int],
    capacity_ah: FloatArray,
    capacity_sigma_ah: FloatArray,
    resistance_ohm: FloatArray,
    current_a: float,
    seed: int = 0,
) -> WithoutModule:
    """Return what a string is without modules: medians and bands of strings whose capacities are drawn.

    Energy is taken as capacity times the number of modules: their mean voltages are alike. A module of which nothing
    is known counts as the median.
    """
    capacity, sigma, resistance = (
        np.where(np.isfinite(values), values, np.nanmedian(values))
        for values in (capacity_ah, capacity_sigma_ah, resistance_ohm)
    )
    kept = np.setdiff1d(np.arange(capacity.size), removed)
    drawn = _drawn(capacity, sigma, np.random.default_rng(seed))
    whole, less = drawn.min(axis=1), drawn[:, kept].min(axis=1)
    energies = less * kept.size / (whole * capacity.size)
    low, middle, high = np.quantile(less, BAND).tolist()
    energy_low, energy, energy_high = np.quantile(energies, BAND).tolist()
    return WithoutModule(
        tuple(sorted(removed)),
        float(np.median(whole)),
        middle,
        low,
        high,
        energy,
        energy_low,
        energy_high,
        float(current_a * (resistance.max() - resistance[kept].max())),
        int(kept[np.argmin(capacity[kept])]),
    )


def _drawn(capacity: FloatArray, sigma: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(DRAWS, n) capacities as they may be: of modules of one kind each is drawn towards their mean (Efron, Morris).

    Where they differ by less than the sigmas say, the errors are one for all: of the current sensor, of the rests.
    """
    n = capacity.size
    differ2, noise2 = float(capacity.var(ddof=1)) if n > 1 else 0.0, max(float(np.mean(sigma**2)), 1e-18)
    total2 = differ2 * (n - 1) / rng.chisquare(max(n - 1, 1), (DRAWS, 1))  # how far they differ is not known exactly
    own2 = sigma**2 * np.minimum(total2 / noise2, 1.0)
    spread2 = np.maximum(total2 - noise2, 0.0)
    weight = spread2 / np.maximum(spread2 + own2, 1e-300)
    mean = float(np.mean(capacity)) + np.sqrt(total2 / n) * rng.standard_normal((DRAWS, 1))
    shared = np.sqrt(np.maximum(noise2 - total2, 0.0)) * rng.standard_normal((DRAWS, 1))
    own = np.sqrt(weight * own2) * rng.standard_normal((DRAWS, n))
    return np.asarray(mean + weight * (capacity - mean) + shared + own)
