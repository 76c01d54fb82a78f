"""Resistance of every cell over that of its cell file, from the drops of driving, from one session to the next.

What an earlier session found is where the next one begins, less sure by what temperature and age may have changed. The
regression itself is the C engine's (`filters/engine/native_resistance.py`).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.errors import ShapeError
from app.estimation.filters.engine.native_resistance import FACTOR_MAX, FACTOR_MIN, NativeResistance
from app.estimation.filters.estimates import N_OUT, Estimates

PRIOR_SIGMA: Final = 0.3
CHANGED_SIGMA: Final = 0.05  # from one session to the next
SHAPE_ERROR: Final = 0.25  # by which a factor is off because a circuit's drop over time is not a cell's ...
LESS_SHAPE_ERROR: Final = 0.35  # ... and where it seems to resist less: age makes no cell better


class ResistanceScale:
    """Factors of all cells; give it every sample."""

    def __init__(self, n_cells: int, past: FloatArray | None = None) -> None:
        """Begin.

        Args:
            n_cells: number of cells.
            past: (2, n_cells) factor and sigma at the end of an earlier session; None = there was none.
        """
        if past is None or past.shape != (2, n_cells):  # another accumulator, or none
            past = np.tile([[1.0], [PRIOR_SIGMA]], n_cells)
        factor, sigma = past
        is_known = (factor > FACTOR_MIN) & (factor < FACTOR_MAX) & (sigma > 0.0)
        sigma = np.where(is_known, np.hypot(sigma, CHANGED_SIGMA), PRIOR_SIGMA)
        prior_weight = 1.0 / np.minimum(sigma, PRIOR_SIGMA) ** 2
        self._shape = (n_cells,)
        self.regression = NativeResistance(np.where(is_known, factor, 1.0), prior_weight)

    def step(self, dt_s: float, estimates: Estimates, factor: FloatArray, voltages_v: FloatArray) -> None:
        """Take one sample.

        Args:
            dt_s: since the previous one, >= 0 [s].
            estimates: of this sample.
            factor: (n_cells,) resistances over those of the cell file that they were made with.
            voltages_v: (n_cells,) measured [V]; NaN = missing.

        Raises:
            ShapeError: an array is not (n_cells,).
        """
        self.run(np.array([dt_s]), Estimates(estimates.numbers[:, None]), factor, voltages_v[None])

    def run(self, dt_s: FloatArray, estimates: Estimates, factor: FloatArray, voltage_v: FloatArray) -> None:
        """Take samples in a row, as so many calls of `step` would.

        Args:
            dt_s: (n_steps,) since the sample before, >= 0 [s].
            estimates: of these samples, (n_steps, n_cells) each.
            factor: (n_cells,) as in `step`.
            voltage_v: (n_steps, n_cells) measured [V]; NaN = missing.

        Raises:
            ShapeError: the arrays do not fit each other.
        """
        rows = (dt_s.size, *self._shape)
        numbers = estimates.numbers
        for name, shape, array in (
            ("voltages_v", rows, voltage_v),
            ("factor", self._shape, factor),
            ("estimates", (N_OUT, *rows), numbers),
        ):
            if array.shape != shape:
                raise ShapeError(name, shape, array.shape)
        self.regression.record(dt_s, numbers.swapaxes(0, 1), factor, voltage_v)

    def judge(self) -> tuple[FloatArray, FloatArray]:
        """Return (n_cells,) resistances over those of the cell file, the past where nothing showed them, and sigmas."""
        factor, sigma = self.regression.judge()
        return factor, sigma


def filter_factor(factor: FloatArray, is_learned: BoolArray) -> FloatArray:
    """Return (n_cells,) the factors a filter may predict voltages with.

        f' = s(m) f / m,   m the median of those that were learned;   f' = s(m) where none was

    What all cells share may be the model's error and counts as far as `shared_factor` s says. What they differ by is
    not: it counts whole.

    Args:
        factor: (n_cells,) of `ResistanceScale`.
        is_learned: (n_cells,) where it is known.
    """
    if not is_learned.any():
        return np.ones(factor.shape)
    median = np.median(factor[is_learned])
    return np.asarray(shared_factor(median) * np.where(is_learned, factor / median, 1.0))


def shared_factor(factor: ArrayLike) -> FloatArray:
    """Return how much of a factor that all cells share counts: 1 + g / (1 + (s / g)^6), g = factor - 1.

    What is fast in a drop and what lasts do not grow alike: good models of fresh cells are found up to a fifth off.
    That is left to the model; growth well beyond it is taken nearly whole. A factor below 1 has to lie farther off:
    age does not explain it, and what lasts need not follow (0.78 seen on LFP).
    """
    own = np.asarray(factor, dtype=np.float64)
    growth = own - 1.0
    growth6 = (growth * growth) * (growth * growth) * (growth * growth)
    uncertainty6 = np.where(own < 1.0, LESS_SHAPE_ERROR**6, SHAPE_ERROR**6)
    return np.asarray(1.0 + growth * growth6 / (growth6 + uncertainty6))
