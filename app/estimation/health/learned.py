"""What is known of the cells beyond their cell file, and where it is known well enough to be counted with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray

CAPACITY_SIGMA_MAX_FRAC: Final = 0.03  # of the nominal capacity
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
