"""The offset of the current sensor, by a filter that compares voltages with a count of the measured charge.

    z_f(t) + Q(t) = z_0 + g Q(t) + b t / (3600 C) + e(t)

z_f is the SOC of a filter that started from voltage alone, Q the measured charge over the capacity C, b the offset, g
the error of gain and capacity. e is the filter's error; it lasts, so comparisons closer than `LASTING_S` repeat it.
A start, a gain and an offset are estimated together with priors, so that what the run cannot distinguish stays as
uncertain as it was: after half an hour of driving an offset of 0.0067C has moved 0.3 points of SOC, less than any
model's error. A rest of hours, or a day of driving with rests, shows it; a minute with the relays open shows it at
once, because then no current can flow.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR

COMPARE_S: Final = 60.0  # between two comparisons
LASTING_S: Final = 300.0  # correlation time of a filter's error in SOC
START_SIGMA: Final = 0.5
GAIN_SIGMA: Final = 0.01
OFFSET_SIGMA_C: Final = 0.01
OFFSET_WALK_C: Final = 0.001  # how far it wanders in an hour, with its heat
OPEN_SIGMA_C: Final = 0.001  # sigma of a mean over a comparison with the relays open
OBSERVED_SHARE: Final = 0.5  # share of the prior: a smaller sigma means that the run has shown the offset
SIGMA_MIN: Final = 1e-3  # sigma of a filter's SOC
START: Final = 0  # its place before gain and offset
OFFSET: Final = 2


class SensorOffset(NamedTuple):
    """The estimated offset of the current sensor.

    Attributes:
        offset_a: positive where the sensor reads more discharge than flows [A].
        sigma_a: its standard deviation; that of the prior, 0.01C, where nothing has shown it [A].
        is_observed: sigma has fallen below half of the prior.
    """

    offset_a: float
    sigma_a: float
    is_observed: bool


class OffsetTracker:
    """Estimates the offset along a run; cells that share the sensor count once, by their mean."""

    def __init__(self, capacity_ah: float) -> None:
        self._prior_a = OFFSET_SIGMA_C * capacity_ah
        self._mean = np.array([0.5, 0.0, 0.0])
        self._cov = np.diag([START_SIGMA, GAIN_SIGMA, self._prior_a]) ** 2
        self._capacity_ah = capacity_ah
        self._since_s = 0.0
        self._drawn = 0.0
        self._per_a = 0.0  # SOC that one ampere has moved since the start
        self._open_s = 0.0
        self._open_as = 0.0

    def use_capacity(self, capacity_ah: float) -> None:
        """Count the charge from now on over another capacity, the mean of the cells' [Ah]."""
        self._capacity_ah = capacity_ah

    def step(self, dt_s: float, current_a: float, is_open: bool = False) -> bool:
        """Count one sample; True when the next comparison is due.

        Args:
            dt_s: since the last sample [s].
            current_a: measured, positive on discharge; not finite = not counted [A].
            is_open: the relays are open: whatever is measured is offset.
        """
        self._since_s += dt_s
        share = dt_s / (SECONDS_PER_HOUR * self._capacity_ah)
        self._per_a += share
        if np.isfinite(current_a):
            self._drawn += current_a * share
            self._open_s = self._open_s + dt_s if is_open else 0.0
            self._open_as = self._open_as + current_a * dt_s if is_open else 0.0
        return self._since_s >= COMPARE_S

    def interrupt(self) -> None:
        """Start at a new SOC: the charge since the last sample is unknown."""
        self._mean[START] = 0.5
        self._cov[START] = self._cov[:, START] = 0.0
        self._cov[START, START] = START_SIGMA**2
        self._drawn = self._per_a = self._since_s = self._open_s = self._open_as = 0.0

    def compare(self, soc: FloatArray, soc_sigma: FloatArray) -> None:
        """Compare with what the filter says now.

        Args:
            soc: (n,) SOC of a filter that uses voltages only.
            soc_sigma: (n,) its standard deviation, model error included.
        """
        walk_a = OFFSET_WALK_C * self._capacity_ah
        self._cov[OFFSET, OFFSET] += walk_a * walk_a * self._since_s / SECONDS_PER_HOUR
        row = np.array([1.0, self._drawn, self._per_a])
        repeated = max(1.0, 2.0 * LASTING_S / max(self._since_s, 1e-9))
        variance = repeated * max(float(np.mean(soc_sigma)), SIGMA_MIN) ** 2
        self._learn(row, float(np.mean(soc)) + self._drawn, variance)
        if self._open_s >= COMPARE_S:
            open_v2 = (OPEN_SIGMA_C * self._capacity_ah) ** 2
            self._learn(np.array([0.0, 0.0, 1.0]), self._open_as / self._open_s, open_v2)
            self._open_s = self._open_as = 0.0
        self._since_s = 0.0

    def estimate(self) -> SensorOffset:
        """Return what the comparisons so far say."""
        sigma_a = float(np.sqrt(self._cov[OFFSET, OFFSET]))
        return SensorOffset(float(self._mean[OFFSET]), sigma_a, sigma_a < OBSERVED_SHARE * self._prior_a)

    def _learn(self, row: FloatArray, value: float, variance: float) -> None:
        column = self._cov @ row
        total = float(row @ column) + variance
        self._mean += column * ((value - float(row @ self._mean)) / total)
        self._cov -= np.outer(column, column) / total
