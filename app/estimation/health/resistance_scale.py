"""How much more every cell resists than its cell file says, from the drops of driving.

    y = v_ocv - v,   x = v_ocv - v_model          y = f x + error; both without what is slower than `DRIFT_S`

All resistances of a cell are taken to grow alike. What is slow is SOC, heat and overpotential and tells nothing. The
model's error is not white and lasts about `LASTING_S`, so closer samples repeat each other. What an earlier session
found is where the next one begins, less sure by what temperature and age may have changed.
"""

from __future__ import annotations

from math import exp
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.errors import ShapeError

DRIFT_S: Final = 40.0
MEMORY_S: Final = 300.0  # four or five laps; heat changes resistances, and the model follows heat only in part
LASTING_S: Final = 6.0  # of an error from which the drift has been taken
RESTART_S: Final = 2.0  # a hole this long begins the drift anew
PRIOR_SIGMA: Final = 0.3
CHANGED_SIGMA: Final = 0.05  # from one session to the next
SHAPE_ERROR: Final = 0.25  # by which a factor is off because a circuit's drop over time is not a cell's ...
LESS_SHAPE_ERROR: Final = 0.35  # ... and where it seems to resist less: age makes no cell better
FACTOR_MIN, FACTOR_MAX = 0.2, 10.0  # beyond it, it is no resistance
QUIET_V: Final = 2e-3  # where no cell's drop moves more, nothing can be learnt and nothing is forgotten
DROP_MAX_V: Final = 1.5  # a larger difference of voltages is a measurement that failed


class ResistanceScale:
    """Regression through the origin of measured on modelled drops, with fading memory; call `step` every sample."""

    def __init__(self, n_cells: int, past: FloatArray | None = None) -> None:
        """Begin.

        Args:
            n_cells: number of cells.
            past: (2, n_cells) factor and sigma at the end of an earlier session; None = there was none.
        """
        if past is None or past.shape != (2, n_cells):  # of another accumulator, or of none
            past = np.tile([[1.0], [PRIOR_SIGMA]], n_cells)
        factor, sigma = past
        is_known = (factor > FACTOR_MIN) & (factor < FACTOR_MAX) & (sigma > 0.0)
        self._prior = np.where(is_known, factor, 1.0)
        sigma = np.where(is_known, np.hypot(sigma, CHANGED_SIGMA), PRIOR_SIGMA)
        self._prior_weight = 1.0 / np.minimum(sigma, PRIOR_SIGMA) ** 2
        self._shape = (n_cells,)
        self._drift = np.zeros((2, n_cells))  # of y and x [V]
        self._sums = np.zeros((3, n_cells))  # weights times x x, x y, y y, times seconds [V^2 s]
        self._weight_s = np.zeros(n_cells)
        self._has_drift = np.zeros(n_cells, dtype=np.bool_)
        self._gains = (-1.0, 0.0, 1.0)

    def step(self, dt_s: float, ocv_v: FloatArray, model_v: FloatArray, voltages_v: FloatArray) -> None:
        """Take one sample.

        Args:
            dt_s: since the previous one, >= 0 [s].
            ocv_v: (n_cells,) open-circuit voltage of the estimate [V].
            model_v: (n_cells,) terminal voltage the cell file predicts [V].
            voltages_v: (n_cells,) measured [V]; NaN = missing.

        Raises:
            ShapeError: an array is not (n_cells,).
        """
        for name, array in (("ocv_v", ocv_v), ("model_v", model_v), ("voltages_v", voltages_v)):
            if array.shape != self._shape:
                raise ShapeError(name, self._shape, array.shape)
        drops = np.array((ocv_v - voltages_v, ocv_v - model_v))
        if dt_s > RESTART_S:
            self._has_drift[:] = False
        if dt_s != self._gains[0]:
            self._gains = dt_s, 1.0 - exp(-dt_s / DRIFT_S), exp(-dt_s / MEMORY_S)
        _, share, fade = self._gains
        known = (np.abs(drops) < DROP_MAX_V).all(axis=0)
        fresh = known & ~self._has_drift
        if fresh.any():
            self._drift[:, fresh] = drops[:, fresh]
            self._has_drift |= fresh
        if not known.all():
            drops = np.where(known, drops, self._drift)
        drops -= self._drift
        self._drift += share * drops
        y, x = drops
        if float(np.abs(x).max()) < QUIET_V:
            return
        self._sums *= fade
        self._sums += dt_s * np.array((x * x, x * y, y * y))
        self._weight_s *= fade
        self._weight_s += dt_s * known

    def factor(self) -> FloatArray:
        """Return (n_cells,) resistance over that of the cell file; the past or 1 where nothing has shown it."""
        xx, xy, _ = self._sums
        error_v2s, weight = self._error_v2s(), self._prior_weight
        factor = (xy / error_v2s + weight * self._prior) / (xx / error_v2s + weight)
        return np.asarray(np.clip(factor, FACTOR_MIN, FACTOR_MAX))

    def sigma(self) -> FloatArray:
        """Return (n_cells,) its standard deviation."""
        return np.asarray(1.0 / np.sqrt(self._sums[0] / self._error_v2s() + self._prior_weight))

    def _error_v2s(self) -> FloatArray:
        """Return (n_cells,) variance of the error times the time over which it repeats itself [V^2 s]."""
        xx, xy, yy = self._sums
        with np.errstate(divide="ignore", invalid="ignore"):
            left = np.where(xx > 0.0, yy - xy * xy / xx, yy) / self._weight_s
        return np.asarray(2.0 * LASTING_S * np.maximum(np.nan_to_num(left), 1e-6))


def trusted_factor(factor: FloatArray) -> FloatArray:
    """Return the factor a filter may predict voltages with: 1 + g / (1 + (s / g)^6), g = factor - 1.

    What is fast in a drop and what lasts do not grow alike, and a joint adds to the first alone: good models of fresh
    cells are found up to a fifth off. That is left to the model; growth well beyond it is taken nearly whole. A
    factor below 1 has to lie farther off: age does not explain it, and what lasts need not follow (0.78 seen on LFP).

    Args:
        factor: (n_cells,) as learned.
    """
    growth6 = (factor - 1.0) ** 6
    doubt6 = np.where(factor < 1.0, LESS_SHAPE_ERROR, SHAPE_ERROR) ** 6
    return np.asarray(1.0 + (factor - 1.0) * growth6 / (growth6 + doubt6))
