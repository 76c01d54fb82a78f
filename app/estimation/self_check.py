"""Does the model describe this cell? Slow averages of the innovation and of its square answer per cell.

    m' = m + (1 - exp(-dt / T)) (y - m)         of y = nu sqrt(r_0 / r), the innovation scaled to rest

over `check_s` for y and y^2, over `bias_s` for y, and over `check_s` again for the square of that: an innovation that
does not average out is an error the filter takes for charge.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from app.estimation.states import CellStates
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]


class SelfCheck:
    """Slow averages of the innovations of one state."""

    def __init__(self, states: CellStates, tuning: Tuning) -> None:
        self._check = states.check
        self._bias_v2 = states.bias_v2
        self._tuning = tuning
        self._work = np.empty_like(states.check)
        self._views = *states.check, *self._work
        self._weights = np.empty((3, 1))
        self._limits = np.array(tuning.check_bias_v), np.array(tuning.check_rms_v * tuning.check_rms_v)

    def update(
        self, dt_s: float, innovation_v: FloatArray, noise_v2: float, counts: NDArray[np.bool_] | None
    ) -> NDArray[np.bool_]:
        """Return (n,) True while the model is valid, and move the averages on.

        The limits stand for rest and low current; at high current an error in proportion to the assumed one passes.

        Args:
            dt_s: step [s].
            innovation_v: (n,) measured minus predicted [V].
            noise_v2: variance assumed for the model's error at this current [V^2].
            counts: (n,) False where the sample is missing or was refused: it says nothing about the model. None = all
                do.
        """
        tuning, moved = self._tuning, self._work
        mean, square, slow, scaled, scaled2, again = self._views
        if counts is not None:
            innovation_v = np.where(counts, innovation_v, 0.0)
        np.multiply(innovation_v, tuning.model_error_v / math.sqrt(noise_v2), scaled)
        np.multiply(scaled, scaled, scaled2)
        np.copyto(again, scaled)
        np.subtract(moved, self._check, moved)
        weight = 1.0 - math.exp(-dt_s / tuning.check_s)
        self._weights[:2] = weight
        self._weights[2] = 1.0 - math.exp(-dt_s / tuning.bias_s)
        np.multiply(moved, self._weights, moved)
        if counts is not None:
            moved *= counts
        np.add(self._check, moved, self._check)
        np.multiply(slow, slow, again)
        np.subtract(again, self._bias_v2, again)
        np.multiply(again, weight, again)
        if counts is not None:
            again *= counts
        np.add(self._bias_v2, again, self._bias_v2)
        bias_limit, square_limit = self._limits
        np.absolute(mean, scaled)
        valid: NDArray[np.bool_] = np.less(square, square_limit)
        np.logical_and(valid, np.less(scaled, bias_limit), valid)
        return valid
