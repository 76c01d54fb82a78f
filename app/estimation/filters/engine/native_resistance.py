"""The C engine's regression of resistances: how much more every cell resists than its cell file says.

Its memory is numpy's; the equations are in `vw_resistance.c`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.filters.engine.library import LearningStruct, load
from app.estimation.filters.engine.native import NativeEngine
from app.estimation.filters.estimates import N_OUT

ROWS: Final = 14  # VW_RESISTANCE_ROWS
PRIOR, PRIOR_WEIGHT, FACTOR = 10, 11, 12  # the sigma follows the factor
LASTING_S: Final = 6.0  # time constant of errors without drift; this and the next as in `vw_resistance.c`
FACTOR_MIN, FACTOR_MAX = 0.2, 10.0  # beyond it, it is no resistance


class NativeResistance:
    """The regression over n_cells cells, from a prior factor and one over its variance, (n_cells,) each."""

    def __init__(self, prior: FloatArray, prior_weight: FloatArray) -> None:
        """Begin.

        Raises:
            EstimatorError: there is no library for this machine.
        """
        self._library = load()
        self._rows = np.zeros((ROWS, prior.size))
        self._rows[PRIOR], self._rows[PRIOR_WEIGHT] = prior, prior_weight
        self._at = ctypes.c_int32(prior.size), ctypes.c_void_p(self._rows.ctypes.data)

    def record(self, dt_s: FloatArray, numbers: FloatArray, factor: FloatArray, voltage_v: FloatArray) -> None:
        """Take n_steps samples in a row.

        Args:
            dt_s: (n_steps,) since the sample before [s].
            numbers: (n_steps, 8, n_cells) of a filter, as in `Estimates`.
            factor: (n_cells,) resistances over those of the cell file that the filter counted with.
            voltage_v: (n_steps, n_cells) measured [V]; NaN = missing.
        """
        arrays = [np.ascontiguousarray(array, np.float64) for array in (dt_s, numbers, factor, voltage_v)]
        dt_at, *others = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        self._library.vw_resistance_record(*self._at, ctypes.c_int64(dt_s.size), dt_at, *others)

    def learn(
        self, engine: NativeEngine, learning: LearningStruct, samples: Sequence[FloatArray], factor: FloatArray
    ) -> FloatArray:
        """Return (8, n_steps, n_cells) what a filter says of samples while it learns and uses resistances.

        Args:
            engine: the filter.
            learning: how; its time goes on.
            samples: as in `learn_along`, n_steps rows each.
            factor: (n_cells,) resistances in use, overwritten by those at the end.
        """
        arrays = [np.ascontiguousarray(sample, np.float64) for sample in samples]
        numbers = np.empty((arrays[0].size, N_OUT, factor.size))
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*arrays, factor, numbers)]
        n_steps = ctypes.c_int64(arrays[0].size)
        self._library.vw_resistance_learn(*engine.at, self._at[1], ctypes.byref(learning), n_steps, *pointers)
        return numbers.swapaxes(0, 1)

    def judge(self) -> FloatArray:
        """Return (2, n_cells) factor and its standard deviation."""
        self._library.vw_resistance_judge(*self._at)
        return self._rows[FACTOR : FACTOR + 2].copy()
