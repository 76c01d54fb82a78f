"""What every filter answers, and the interface all of them share."""

from __future__ import annotations

from typing import Final, Protocol

from numpy.typing import ArrayLike

from app.estimation.arrays import BoolArray, FloatArray

N_OUT: Final = 8
OUT_SOC, OUT_SIGMA, OUT_OCV, OUT_VOLTAGE, OUT_INNOVATION, OUT_INNOVATION_SIGMA, OUT_VALID, OUT_ACCEPTED = range(N_OUT)


class Estimates:
    """What one step says about every cell; all arrays are (n_cells,) and belong to the reader.

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


class CellEstimator(Protocol):
    """A filter over n_cells cells that share one current."""

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        ...

    @property
    def state_mean(self) -> FloatArray:
        """(n_states, n_cells) mean: SOC, then the RC currents [A]; a copy."""
        ...

    @property
    def state_cov(self) -> FloatArray:
        """(n_cells, n_states, n_states) covariance; a copy."""
        ...

    def start(
        self,
        voltages_v: ArrayLike,
        temperatures_degc: ArrayLike,
        current_a: float,
        soc: ArrayLike | None = None,
        soc_sigma: ArrayLike | None = None,
    ) -> None:
        """Set the state from one sample.

        Args:
            voltages_v: (n_cells,) [V]; NaN where not measured.
            temperatures_degc: (n_cells,) [degC]; NaN where not measured.
            current_a: positive on discharge [A].
            soc: known SOC at this moment, scalar or (n_cells,), NaN = unknown; None = take it from the voltage.
            soc_sigma: how far that may be off; None = the filter's own default.

        Raises:
            ShapeError: an array is not (n_cells,).
        """
        ...

    def voltage_soc(self) -> tuple[FloatArray, FloatArray] | None:
        """Return (n_cells,) SOC by voltages alone and its sigma; None where a count or a given SOC has a part in it."""
        ...

    def use_capacity(self, capacity_ah: ArrayLike) -> None:
        """From the next step on count with capacities of the cells' own instead of the cell file's.

        Args:
            capacity_ah: (n_cells,) or scalar [Ah].

        Raises:
            ShapeError: it is neither.
            EstimatorError: one is not finite and positive.
        """
        ...

    def widen(self, soc_sigma: ArrayLike) -> None:
        """Know the SOC less surely, because charge has moved that was not measured.

        Args:
            soc_sigma: (n_cells,) or scalar, standard deviation of that charge over the capacity.

        Raises:
            ShapeError: it is neither.
        """
        ...

    def capacity(self) -> tuple[FloatArray, FloatArray]:
        """Return (n_cells,) capacities as far as the run contradicts the ones counted with, and their sigmas [Ah]."""
        ...

    def use_resistance(self, factor: ArrayLike) -> None:
        """From the next step on predict voltages with resistances that differ from the cell file's.

        Args:
            factor: (n_cells,) or scalar, all resistances of a cell over those of the cell file.

        Raises:
            ShapeError: it is neither.
            EstimatorError: one is not finite and positive.
        """
        ...

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> Estimates:
        """Return the estimates after one sample.

        Args:
            dt_s: time since the previous sample, >= 0; hours are allowed [s].
            current_a: current held over that time, positive on discharge [A]; NaN = not measured, the last one counts.
            voltages_v: (n_cells,) [V]; NaN where not measured.
            temperatures_degc: (n_cells,) [degC]; NaN where not measured, the last one counts.

        Raises:
            ShapeError: an array is not (n_cells,).
            EstimatorError: dt_s is negative or not finite, or `start` was never called.
        """
        ...
