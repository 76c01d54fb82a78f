"""State of health: capacity of every cell from sessions of driving and charging, and both healths against new.

Between two moments at which the SOC of a cell is known (a rest, a full charge) the charge y counted and the SOC x moved
are both noisy, so a plain regression of y on x comes out too small. The estimate minimises the approximate weighted
total least squares with fading memory

    chi2(Q) = (c4 Q^4 - 2 c5 Q^3 + (c1 + c6) Q^2 - 2 c2 Q + c3) / (1 + Q^2)^2

whose six sums are all that is kept. Source: Plett, J. Power Sources 196 (2011) 2319, AWTLS. It is exact where x and y
have errors of equal size, so y is counted in units of the nominal capacity over `ERROR_RATIO`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.errors import ModelError, ShapeError

FADE: Final = 0.98  # weight of an older session with every new one: about fifty sessions are remembered
START_SIGMA_FRAC: Final = 0.05  # how far the nominal capacity may be off before any session
SOC_MOVED_MIN: Final = 0.1  # less than this shows nothing that the errors would not drown
SEARCH_FRAC: Final = (0.3, 1.5)  # shares of the nominal capacity
SEARCH_POINTS: Final = 241
NEWTON_STEPS: Final = 4
RESISTANCE_END_OF_LIFE: Final = 2.0  # times the new resistance
WORST_SIGMA_FRAC: Final = 0.5
ERROR_RATIO: Final = 2.5  # error of an SOC change over relative error of a charge count: 1 % against 0.4 %


class CapacityTracker:
    """Capacity of every cell across sessions, with its standard deviation."""

    def __init__(self, nominal_ah: ArrayLike, n_cells: int, stored: FloatArray | None = None) -> None:
        """Start from the nominal capacity, or go on from what an earlier session stored.

        Args:
            nominal_ah: (n_cells,) or scalar, capacity when new [Ah].
            n_cells: number of cells.
            stored: `state` of an earlier tracker of the same cells.

        Raises:
            ModelError: a nominal capacity is not finite and positive.
            ShapeError: the stored sums belong to another number of cells.
        """
        nominal = np.array(np.broadcast_to(np.asarray(nominal_ah, dtype=np.float64), (n_cells,)))
        if not (np.isfinite(nominal).all() and (nominal > 0.0).all()):
            raise ModelError("nominal_ah", "has to be finite and positive")
        if stored is not None and stored.shape != (6, n_cells):
            raise ShapeError("stored", (6, n_cells), stored.shape)
        self.nominal_ah = nominal
        self._sums = np.zeros((6, n_cells)) if stored is None else stored.copy()
        if stored is None:
            # the nominal capacity enters as one session of a full charge with the error of START_SIGMA_FRAC
            half = START_SIGMA_FRAC / np.sqrt(2.0)
            one = np.ones(n_cells)
            self._add(one, half * one, ERROR_RATIO * one, ERROR_RATIO * half * one)

    @property
    def state(self) -> FloatArray:
        """(6, n_cells) what to store for the next session; a copy."""
        return self._sums.copy()

    def observe(
        self,
        soc_moved: ArrayLike,
        soc_moved_sigma: ArrayLike,
        charge_ah: ArrayLike,
        charge_sigma_ah: ArrayLike,
    ) -> None:
        """Take one stretch between two known SOCs, charging or discharging.

        The SOCs must not come from counting charge over this capacity: use rests, full charges or a voltage filter.

        Args:
            soc_moved: (n_cells,) change of SOC; cells that moved less than 10 %, or NaN, are left out.
            soc_moved_sigma: (n_cells,) or scalar, its standard deviation.
            charge_ah: (n_cells,) or scalar, charge counted with the same sign [Ah].
            charge_sigma_ah: (n_cells,) or scalar, its standard deviation: sensor gain and offset [Ah].

        Raises:
            ModelError: a standard deviation is not positive.
        """
        shape = self.nominal_ah.shape
        x, sx, y, sy = (
            np.broadcast_to(np.asarray(value, dtype=np.float64), shape)
            for value in (soc_moved, soc_moved_sigma, charge_ah, charge_sigma_ah)
        )
        informative = np.isfinite(x) & np.isfinite(y) & (np.abs(x) >= SOC_MOVED_MIN)
        if not ((sx[informative] > 0.0) & (sy[informative] > 0.0)).all():
            raise ModelError("sigma", "has to be positive: neither SOC nor charge is known exactly")
        informative &= np.isfinite(sx) & np.isfinite(sy)
        unit = self.nominal_ah / ERROR_RATIO
        self._sums *= np.where(informative, FADE, 1.0)
        x, y = np.where(informative, x, 0.0), np.where(informative, y / unit, 0.0)
        self._add(x, np.where(informative, sx, 1.0), y, np.where(informative, sy / unit, 1.0))

    def capacity_ah(self) -> FloatArray:
        """Return (n_cells,) the most likely capacity [Ah]."""
        return np.asarray(self._best() * self.nominal_ah / ERROR_RATIO)

    def sigma_ah(self) -> FloatArray:
        """Return (n_cells,) its standard deviation [Ah]: from the curvature of chi2 at its minimum."""
        best = self._best()
        curvature = _chi2_derivatives(best, self._sums)[1]
        worst = WORST_SIGMA_FRAC * ERROR_RATIO
        with np.errstate(divide="ignore", invalid="ignore"):
            sigma = np.where(curvature > 0.0, np.sqrt(2.0 / curvature), worst)
        return np.asarray(np.minimum(sigma, worst) * self.nominal_ah / ERROR_RATIO)

    def _add(self, x: FloatArray, sx: FloatArray, y: FloatArray, sy: FloatArray) -> None:
        self._sums += np.stack(
            (x * x / sy**2, x * y / sy**2, y * y / sy**2, x * x / sx**2, x * y / sx**2, y * y / sx**2)
        )

    def _best(self) -> FloatArray:
        """Return the minimum of chi2 in units of x and y: a grid, then Newton's steps inside its cell."""
        grid = ERROR_RATIO * np.linspace(*SEARCH_FRAC, SEARCH_POINTS)[:, None]
        best = grid[np.argmin(_chi2(grid, self._sums[:, None, :]), axis=0), 0]
        low, high = best - (grid[1, 0] - grid[0, 0]), best + (grid[1, 0] - grid[0, 0])
        for _ in range(NEWTON_STEPS):
            slope, curvature = _chi2_derivatives(best, self._sums)
            step = np.where(curvature > 0.0, slope / np.where(curvature > 0.0, curvature, 1.0), 0.0)
            best = np.asarray(np.clip(best - step, low, high))
        return np.asarray(best)


def _chi2(q: FloatArray, c: FloatArray) -> FloatArray:
    value = c[3] * q**4 - 2.0 * c[4] * q**3 + (c[0] + c[5]) * q**2 - 2.0 * c[1] * q + c[2]
    return np.asarray(value / (1.0 + q * q) ** 2)


def _chi2_derivatives(q: FloatArray, c: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the first and second derivative of chi2; the second by the quotient rule on the first."""
    numerator = (
        c[4] * q**4
        + (2.0 * c[3] - c[0] - c[5]) * q**3
        + 3.0 * (c[1] - c[4]) * q**2
        + (c[0] - 2.0 * c[2] + c[5]) * q
        - c[1]
    )
    rise = (
        4.0 * c[4] * q**3
        + 3.0 * (2.0 * c[3] - c[0] - c[5]) * q**2
        + 6.0 * (c[1] - c[4]) * q
        + (c[0] - 2.0 * c[2] + c[5])
    )
    below = 1.0 + q * q
    return 2.0 * numerator / below**3, 2.0 * (rise / below**3 - 6.0 * q * numerator / below**4)


@dataclass(frozen=True)
class StateOfHealth:
    """Health of every cell against new, (n_cells,): 1 = new; resistance health is 0 at twice the new resistance."""

    capacity: FloatArray
    capacity_sigma: FloatArray
    resistance: FloatArray


def state_of_health(
    capacity_ah: FloatArray,
    capacity_sigma_ah: FloatArray,
    new_capacity_ah: ArrayLike,
    resistance_factor: ArrayLike,
) -> StateOfHealth:
    """Return capacity and resistance against new.

    Args:
        capacity_ah: (n_cells,) present capacity [Ah].
        capacity_sigma_ah: (n_cells,) its standard deviation [Ah].
        new_capacity_ah: (n_cells,) or scalar, when new [Ah].
        resistance_factor: (n_cells,) present resistance over the new one at the same temperature, NaN where not known.
    """
    new_ah = np.asarray(new_capacity_ah, dtype=np.float64)
    growth = np.asarray(resistance_factor, dtype=np.float64)
    left = (RESISTANCE_END_OF_LIFE - growth) / (RESISTANCE_END_OF_LIFE - 1.0)
    return StateOfHealth(capacity_ah / new_ah, capacity_sigma_ah / new_ah, np.clip(left, 0.0, 1.0))


REST_A: Final = 1.0  # below, no current flows: what is left is the sensor's noise and offset
REST_S: Final = 120.0  # then the RC pairs have settled to a few millivolts
REST_SOC_SIGMA: Final = 0.015
COUNT_GAIN_SIGMA: Final = 0.005  # sigma of the charge counted
COUNT_OFFSET_A: Final = 0.5  # current of the current sensor


class CapacityBetweenRests:
    """Counts charge from rest to rest and updates the tracker."""

    def __init__(self, cell: CellModel, tracker: CapacityTracker) -> None:
        self._cell = cell
        self.tracker = tracker
        self._rest_s = 0.0
        self._charge_ah = 0.0
        self._elapsed_s = 0.0
        self._anchor: FloatArray | None = None

    def step(self, dt_s: float, current_a: float, voltages_v: FloatArray) -> bool:
        """Count; True where a rest closed a stretch and the capacities are new.

        Args:
            dt_s: since the last sample [s].
            current_a: positive on discharge [A].
            voltages_v: (n_cells,) [V]; NaN = missing.
        """
        self._charge_ah += current_a * dt_s / SECONDS_PER_HOUR
        self._elapsed_s += dt_s
        self._rest_s = self._rest_s + dt_s if abs(current_a) < REST_A else 0.0
        if self._rest_s < REST_S:
            return False
        self._rest_s = 0.0
        soc = self._cell.ocv.soc_at(voltages_v)
        if self._anchor is None:
            self._begin(soc)
            return False
        moved = self._anchor - soc
        if not (np.abs(moved) >= SOC_MOVED_MIN).any():
            return False  # go on counting from the older rest
        sigma_ah = abs(self._charge_ah) * COUNT_GAIN_SIGMA + COUNT_OFFSET_A * self._elapsed_s / SECONDS_PER_HOUR + 1e-3
        self.tracker.observe(moved, REST_SOC_SIGMA * np.sqrt(2.0), self._charge_ah, sigma_ah)
        self._begin(soc)
        return True

    def _begin(self, soc: FloatArray) -> None:
        self._anchor = soc
        self._charge_ah = self._elapsed_s = 0.0
