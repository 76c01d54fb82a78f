"""The answer of every filter."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray

N_OUT: Final = 8
OUT_SOC, OUT_SIGMA, OUT_OCV, OUT_VOLTAGE, OUT_INNOVATION, OUT_INNOVATION_SIGMA, OUT_VALID, OUT_ACCEPTED = range(N_OUT)

UNKNOWN_SIGMA: Final = 12**-0.5  # 1 sigma of a number that may be anything from 0 to 1


class Estimates:
    """The answer of one step; all arrays are (n_cells,) and belong to the reader.

    Attributes:
        numbers: (8, n_cells) what is below, in that order; the last two rows are 0 or 1. Of a record that was run with
            `soc_only` the first two rows alone.
    """

    __slots__ = ("numbers",)

    def __init__(self, numbers: FloatArray) -> None:
        self.numbers = numbers

    @property
    def soc(self) -> FloatArray:
        """State of charge, 0..1."""
        row: FloatArray = self.numbers[OUT_SOC]
        return row

    def known_soc(self, voltages_v: FloatArray) -> FloatArray:
        """(n_cells,) SOC, NaN of cells without a voltage of which no more is known than that it is from 0 to 1."""
        is_unknown = np.isnan(voltages_v) & (self.soc_sigma >= UNKNOWN_SIGMA)
        return np.where(is_unknown, np.nan, self.soc)

    @property
    def soc_sigma(self) -> FloatArray:
        """Its standard deviation, model error included."""
        row: FloatArray = self.numbers[OUT_SIGMA]
        return row

    @property
    def ocv_v(self) -> FloatArray:
        """Open-circuit voltage at that SOC [V]."""
        row: FloatArray = self.numbers[OUT_OCV]
        return row

    @property
    def voltage_v(self) -> FloatArray:
        """Terminal voltage the model predicts for this sample [V]."""
        row: FloatArray = self.numbers[OUT_VOLTAGE]
        return row

    @property
    def innovation_v(self) -> FloatArray:
        """Measured minus predicted [V]; NaN where the cell was not measured."""
        row: FloatArray = self.numbers[OUT_INNOVATION]
        return row

    @property
    def innovation_sigma_v(self) -> FloatArray:
        """Standard deviation the filter expects of the innovation [V]."""
        row: FloatArray = self.numbers[OUT_INNOVATION_SIGMA]
        return row

    @property
    def model_valid(self) -> BoolArray:
        """False where the model has failed its self-check for this cell: distrust its SOC."""
        row: BoolArray = self.numbers[OUT_VALID] != 0.0
        return row

    @property
    def accepted(self) -> BoolArray:
        """True where this sample's voltage was used; False where it was missing or refused as an outlier."""
        row: BoolArray = self.numbers[OUT_ACCEPTED] != 0.0
        return row
