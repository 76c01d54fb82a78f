"""Does the model describe this cell? Slow averages of the innovation and of its square answer per cell.

    m' = m + (1 - exp(-dt / T)) (y - m)         of y = nu sqrt(r_0 / r), the innovation scaled to rest

over `check_s` for y and y^2, over `bias_s` for y, and over `check_s` again for the square of that: an innovation that
does not average out is an error the filter takes for charge.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.estimation.filters.states import CellStates
from app.estimation.filters.tuning import Tuning

_, SQUARE, SLOW, SLOW_SQUARE = range(4)  # rows of the averages


class SelfCheck:
    """Slow averages of the innovations of one state."""

    def __init__(self, states: CellStates, tuning: Tuning) -> None:
        self._averages = states.averages
        self._tuning = tuning
        self._moved = np.empty_like(states.averages)
        self._fresh = tuple(self._moved[:SLOW_SQUARE])
        self._slow, self._slow2 = states.averages[SLOW], self._moved[SLOW_SQUARE]
        self._dt_s = math.nan
        self._weights = np.empty_like(states.averages)
        limits = np.array([[tuning.check_bias_v], [tuning.check_rms_v * tuning.check_rms_v]])
        self._limits = np.repeat(limits, states.n_cells, axis=1)
        self._checked = states.averages[: SQUARE + 1], np.empty_like(self._limits)
        self._scale = np.empty(())  # a scalar costs a ufunc more than an array without dimensions does
        self._within = np.empty(self._limits.shape, dtype=np.bool_)

    def update(
        self, dt_s: float, innovation_v: FloatArray, noise_v2: float, counts: NDArray[np.bool_] | None
    ) -> NDArray[np.bool_]:
        """Return (n,) True while the model is valid, and move the averages on; good until the next call.

        The limits stand for rest and low current; at high current an error in proportion to the assumed one passes.

        Args:
            dt_s: step [s].
            innovation_v: (n,) measured minus predicted [V].
            noise_v2: variance assumed for the model's error at this current [V^2].
            counts: (n,) False where the sample is missing or was refused: it says nothing about the model. None = all
                do.
        """
        scaled, scaled2, scaled_again = self._fresh
        if counts is not None:
            innovation_v = np.where(counts, innovation_v, 0.0)
        self._scale.fill(self._tuning.model_error_v / math.sqrt(noise_v2))
        np.multiply(innovation_v, self._scale, scaled)
        np.multiply(scaled, scaled, scaled2)
        scaled_again[...] = scaled
        self._move(dt_s, counts)
        values, sizes = self._checked
        np.absolute(values, sizes)
        within = np.less(sizes, self._limits, self._within)
        valid: NDArray[np.bool_] = within[0]
        np.logical_and(valid, within[1], valid)
        return valid

    def update_block(
        self, dt_s: list[float], innovation_v: FloatArray, noise_v2: FloatArray, counts: NDArray[np.bool_] | None
    ) -> tuple[NDArray[np.bool_], FloatArray]:
        """Return (k, n) validity after each of k samples and (k, n) `bias_v2` before each [V^2].

        Args:
            dt_s: k steps [s].
            innovation_v: (k, n) as `update` takes them.
            noise_v2: (k,) likewise.
            counts: (k, n) likewise.
        """
        steps, n = innovation_v.shape
        averages, moved = self._averages, self._moved
        if counts is not None:
            innovation_v = np.where(counts, innovation_v, 0.0)
        fresh = np.empty((steps, SLOW_SQUARE, n))
        np.multiply(innovation_v, (self._tuning.model_error_v / np.sqrt(noise_v2))[:, None], fresh[:, 0])
        np.multiply(fresh[:, 0], fresh[:, 0], fresh[:, 1])
        fresh[:, 2] = fresh[:, 0]
        kept = np.empty((1 + steps, *averages.shape))
        kept[0] = averages
        scaled = moved[:SLOW_SQUARE]
        for k, dt in enumerate(dt_s):
            np.copyto(scaled, fresh[k])
            self._move(dt, None if counts is None else counts[k])
            kept[1 + k] = averages
        within = np.absolute(kept[1:, : SQUARE + 1]) < self._limits
        return np.logical_and(within[:, 0], within[:, SQUARE]), kept[:-1, SLOW_SQUARE]

    def _move(self, dt_s: float, counts: NDArray[np.bool_] | None) -> None:
        """Move the averages towards the scaled innovation, its square, and itself again, which stand in `_moved`."""
        moved, averages = self._moved, self._averages
        if dt_s != self._dt_s:
            self._dt_s = dt_s
            self._weights[:] = 1.0 - math.exp(-dt_s / self._tuning.check_s)
            self._weights[SLOW] = 1.0 - math.exp(-dt_s / self._tuning.bias_s)
        np.multiply(self._slow, self._slow, self._slow2)
        np.subtract(moved, averages, moved)
        np.multiply(moved, self._weights, moved)
        if counts is not None:
            moved *= counts
        np.add(averages, moved, averages)
