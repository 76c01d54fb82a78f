"""The offset of the current sensor, by a filter that hears voltages against a count of the measured charge.

    z_f(t) + Q(t) = z_0 + g Q(t) + b t / (3600 C) + e(t)

z_f is the SOC of a filter that started from voltage alone, Q the measured charge over the capacity C, b the offset, g
the error of gain and capacity. e is the filter's error; it lasts, so looks closer than `LASTING_S` repeat each other.
A start, a gain and an offset are estimated together with priors, so that what the run cannot tell apart stays as
uncertain as it was: after half an hour of driving an offset of 0.0067C has moved 0.3 points of SOC, less than any
model's error. A rest of hours, or a day of driving with rests, shows it.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.estimation.circuit import SECONDS_PER_HOUR

FloatArray = NDArray[np.float64]

LOOK_S: Final = 60.0  # between two looks
LASTING_S: Final = 300.0  # correlation time of a filter's error in SOC
START_SIGMA: Final = 0.5
GAIN_SIGMA: Final = 0.01
OFFSET_SIGMA_C: Final = 0.01
OBSERVED_SHARE: Final = 0.5  # of the prior: a smaller sigma means that the run has shown the offset
SIGMA_MIN: Final = 1e-3  # of a filter's SOC
OFFSET: Final = 2  # its place among start, gain and offset


class SensorOffset(NamedTuple):
    """What is known of the offset.

    Attributes:
        offset_a: positive where the sensor reads more discharge than flows [A].
        sigma_a: its standard deviation; that of the prior, 0.01C, where nothing has shown it [A].
        is_observed: sigma has fallen below half of the prior.
    """

    offset_a: float
    sigma_a: float
    is_observed: bool


class OffsetTracker:
    """Estimates the offset along a run; cells that share the sensor are one witness, their mean."""

    def __init__(self, capacity_ah: float) -> None:
        self._coulomb = SECONDS_PER_HOUR * capacity_ah
        self._prior_a = OFFSET_SIGMA_C * capacity_ah
        sigma = np.array([START_SIGMA, GAIN_SIGMA, self._prior_a])
        self._information = np.diag(1.0 / sigma**2)
        self._moment = np.array([0.5 / START_SIGMA**2, 0.0, 0.0])
        self._elapsed_s = 0.0
        self._since_s = 0.0
        self._drawn = 0.0

    def step(self, dt_s: float, current_a: float) -> bool:
        """Count one sample; True when the next look is due.

        Args:
            dt_s: since the last sample [s].
            current_a: measured, positive on discharge; not finite = not counted [A].
        """
        self._elapsed_s += dt_s
        self._since_s += dt_s
        if np.isfinite(current_a):
            self._drawn += current_a * dt_s / self._coulomb
        return self._since_s >= LOOK_S

    def look(self, soc: FloatArray, soc_sigma: FloatArray) -> None:
        """Compare with what the filter says now.

        Args:
            soc: (n,) SOC of a filter that never heard the count.
            soc_sigma: (n,) its standard deviation, model error included.
        """
        row = np.array([1.0, self._drawn, self._elapsed_s / self._coulomb])
        repeated = max(1.0, 2.0 * LASTING_S / max(self._since_s, 1e-9))
        variance = repeated * max(float(np.mean(soc_sigma)), SIGMA_MIN) ** 2
        self._information += np.outer(row, row) / variance
        self._moment += row * ((float(np.mean(soc)) + self._drawn) / variance)
        self._since_s = 0.0

    def estimate(self) -> SensorOffset:
        """Return what the looks so far say."""
        column = np.linalg.solve(self._information, np.eye(3)[OFFSET])
        sigma_a = float(np.sqrt(column[OFFSET]))
        return SensorOffset(float(column @ self._moment), sigma_a, sigma_a < OBSERVED_SHARE * self._prior_a)
