"""What every filter answers, and the interface all of them share."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class Estimates(NamedTuple):
    """What one step says about every cell; all arrays are (n_cells,) and belong to the reader.

    Attributes:
        soc: state of charge, 0..1.
        soc_sigma: its standard deviation, model error included.
        ocv_v: open-circuit voltage at that SOC [V].
        voltage_v: terminal voltage the model predicts for this sample [V].
        innovation_v: measured minus predicted [V]; NaN where the cell was not measured.
        innovation_sigma_v: standard deviation the filter expects of the innovation [V].
        model_valid: False where the model has failed its self-check for this cell: distrust its SOC.
        accepted: True where this sample's voltage was used; False where it was missing or refused as an outlier.
    """

    soc: FloatArray
    soc_sigma: FloatArray
    ocv_v: FloatArray
    voltage_v: FloatArray
    innovation_v: FloatArray
    innovation_sigma_v: FloatArray
    model_valid: BoolArray
    accepted: BoolArray


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
            soc: SOC believed at this moment, scalar or (n_cells,), NaN = unknown; None = read it off the voltage.
            soc_sigma: how far that may be off; None = the filter's own default.

        Raises:
            ShapeError: an array is not (n_cells,).
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
