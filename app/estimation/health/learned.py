"""Parameters of the cells beyond their cell file, and where they are certain enough to be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.filters.engine.library import LearningStruct
from app.estimation.filters.estimates import Estimates
from app.estimation.filters.soc_estimator import SocEstimator
from app.estimation.health.resistance_scale import LESS_SHAPE_ERROR, SHAPE_ERROR, ResistanceScale

CAPACITY_SIGMA_MAX_FRAC: Final = 0.03  # share of the nominal capacity
RESISTANCE_SIGMA_MAX: Final = 0.08


@dataclass(frozen=True)
class Learned:
    """Capacity and resistance to count with, cell by cell; all arrays are (n_cells,).

    Attributes:
        nominal_ah: capacity by the cell file [Ah].
        capacity_ah: learned, or the cell file's [Ah].
        capacity_sigma_ah: its standard deviation [Ah].
        has_capacity: where it was learned.
        resistance_factor: learned resistance over that of the cell file, or 1.
        resistance_sigma: its standard deviation.
        has_resistance: where it was learned.
    """

    nominal_ah: FloatArray
    capacity_ah: FloatArray
    capacity_sigma_ah: FloatArray
    has_capacity: BoolArray
    resistance_factor: FloatArray
    resistance_sigma: FloatArray
    has_resistance: BoolArray


def learned(
    nominal_ah: FloatArray,
    capacity_ah: FloatArray,
    capacity_sigma_ah: FloatArray,
    resistance_factor: FloatArray,
    resistance_sigma: FloatArray,
) -> Learned:
    """Return what to count with: what was learned where its sigma is small, else the cell file.

    Args:
        nominal_ah: (n_cells,) of the cell file [Ah].
        capacity_ah: (n_cells,) of `CapacityTracker` [Ah].
        capacity_sigma_ah: (n_cells,) its standard deviation [Ah].
        resistance_factor: (n_cells,) of `ResistanceScale`.
        resistance_sigma: (n_cells,) its standard deviation.
    """
    has_capacity = np.asarray(capacity_sigma_ah <= CAPACITY_SIGMA_MAX_FRAC * nominal_ah)
    has_resistance = np.asarray(resistance_sigma <= RESISTANCE_SIGMA_MAX)
    return Learned(
        nominal_ah,
        np.where(has_capacity, capacity_ah, nominal_ah),
        np.asarray(capacity_sigma_ah),
        has_capacity,
        np.where(has_resistance, resistance_factor, 1.0),
        np.asarray(resistance_sigma),
        has_resistance,
    )


LEARN_S: Final = 1.0  # between two uses of what was learned


class LearningRun:
    """State that is carried from one piece of a recording to the next.

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
