"""Heat loss of the cells to their surroundings, from what they were given and how they warmed.

    cooling = loss - C dT/dt, both averaged over the same last minutes

Temperatures come in whole degrees, so one mean value over all cells is used. With x = heat given - C T, two means with
the memories s < l give the average as (x_s - x_l) / (l - s).
"""

from __future__ import annotations

from math import exp
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray

SHORT_S: Final = 30.0
LONG_S: Final = 180.0
READY_S: Final = 240.0  # time before the first prediction
UNKNOWN_S: Final = 10.0  # what flowed in a longer gap is not known


class HeatBalance:
    """Mean cooling of the cells; call `step` with every sample."""

    def __init__(self, heat_capacity_j_k: float) -> None:
        self._heat_capacity_j_k = heat_capacity_j_k
        self._given_j = 0.0
        self._means: tuple[float, float] | None = None
        self._ran_s = 0.0

    def step(self, dt_s: float, loss_w: FloatArray, temperature_degc: FloatArray) -> None:
        """Take one sample: (n_cells,) heat given to each cell [W] and its temperature [degC]; NaN = missing."""
        is_finite = np.isfinite(loss_w) & np.isfinite(temperature_degc)
        if dt_s > UNKNOWN_S or not is_finite.any():
            self._means, self._ran_s = None, 0.0
            return
        self._given_j += dt_s * float(loss_w[is_finite].mean())
        x = self._given_j - self._heat_capacity_j_k * float(temperature_degc[is_finite].mean())
        short, long = self._means or (x, x)
        self._means = x + (short - x) * exp(-dt_s / SHORT_S), x + (long - x) * exp(-dt_s / LONG_S)
        self._ran_s += dt_s

    @property
    def cooling_w(self) -> float:
        """Heat that a cell lost on average in the last minutes [W]; 0 while that is not known."""
        if self._means is None or self._ran_s < READY_S:
            return 0.0
        short, long = self._means
        return max((short - long) / (LONG_S - SHORT_S), 0.0)
