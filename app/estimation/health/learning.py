"""A filter along a recording that learns resistances on the way and uses them, a second after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.filters.engine.library import LearningStruct
from app.estimation.filters.estimates import Estimates
from app.estimation.filters.soc_estimator import SocEstimator
from app.estimation.health.learned import RESISTANCE_SIGMA_MAX
from app.estimation.health.resistance_scale import LESS_SHAPE_ERROR, SHAPE_ERROR, ResistanceScale

LEARN_S: Final = 1.0  # between two uses of what was learned


class LearningRun:
    """What goes on from one piece of a recording to the next.

    Attributes:
        scale: what was learned of the resistances.
        factor: (n_cells,) resistances over those of the cell file that the filter counts with now.
    """

    def __init__(self, estimator: SocEstimator) -> None:
        """Begin with an estimator that has been started."""
        self.scale = ResistanceScale(estimator.n_cells)
        self.factor = np.ones(estimator.n_cells)
        self._estimator = estimator
        self._learning = LearningStruct(LEARN_S, 0.0, RESISTANCE_SIGMA_MAX, SHAPE_ERROR, LESS_SHAPE_ERROR)

    def step(self, samples: Sequence[FloatArray]) -> Estimates:
        """Return the estimates of samples in a row, (n_steps, n_cells) each.

        Args:
            samples: (n_steps,) step of the filter [s], time since the sample before with the gap that was bridged
                before it [s], current [A]; (n_steps, n_cells) voltage, voltage to learn from, NaN where nothing is
                learned [V], temperature [degC].
        """
        engine, regression = self._estimator.engine, self.scale.regression
        return Estimates(regression.learn(engine, self._learning, samples, self.factor))

    def judge(self) -> tuple[FloatArray, FloatArray]:
        """Return (n_cells,) factors that were learned, and their sigmas."""
        return self.scale.judge()
