"""The first minutes estimated again, once the resistances of the cells are known.

A start under load reads the SOC off a voltage less a drop that only the cell file knows. Where driving shows other
resistances, the samples kept from the start on are estimated anew with them, as one would do afterwards.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.filters.estimates import Estimates
from app.estimation.filters.soc_estimator import SocEstimator

KEPT_S: Final = 180.0
LEARNED_S: Final = 60.0  # before, a factor rests on a few changes of the current
CHANGE_MIN: Final = 0.03  # change of a factor below which no start moves
LEARNED_SHARE: Final = 0.9  # share of the cells: one that is not measured delays no other

Sample = tuple[float, float, FloatArray, FloatArray]  # step [s], current [A], voltages [V], temperatures [degC]


class FirstMinutes:
    """Samples from the start on, until they have been estimated again or are too many."""

    def __init__(self, factors: FloatArray | float = 1.0) -> None:
        """Begin with an estimator that has such resistances over those of the cell file."""
        self._factors = factors
        self._samples: list[Sample] | None = []
        self._lasted_s = 0.0

    @property
    def is_keeping(self) -> bool:
        """Return whether samples are still kept."""
        return self._samples is not None

    def keep(self, dt_s: float, current_a: float, voltages_v: FloatArray, temperatures_degc: FloatArray) -> None:
        """Take the sample that the estimator is about to take."""
        self._lasted_s += dt_s
        if self._lasted_s > KEPT_S:
            self.drop()
        if self._samples is not None:
            self._samples.append((dt_s, current_a, voltages_v.copy(), temperatures_degc.copy()))

    def drop(self) -> None:
        """Keep nothing: charge has flowed that was not measured, or the time is over."""
        self._samples = None

    def again(
        self, factors: FloatArray, is_learned: BoolArray, restart: Callable[[], SocEstimator]
    ) -> tuple[SocEstimator, Estimates] | None:
        """Return an estimator that has seen all samples with other resistances, and its last estimates; or None.

        Once, when the resistances of the cells have been learned and one of them is worth it.

        Args:
            factors: (n_cells,) resistances over those of the cell file.
            is_learned: (n_cells,) whether they are known.
            restart: makes an estimator that has those factors and was started like the first one.
        """
        if not self._samples or self._lasted_s < LEARNED_S or is_learned.mean() < LEARNED_SHARE:
            return None
        samples = self._samples
        self.drop()
        if float(np.abs(factors - self._factors).max()) < CHANGE_MIN:
            return None
        estimator = restart()
        for sample in samples:
            estimates = estimator.step(*sample)
        return estimator, estimates
