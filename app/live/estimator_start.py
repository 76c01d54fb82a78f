"""How an estimator starts with a measurement: from voltages, an earlier run's SOC, the master's own."""

import numpy as np

from app.estimation.filters.estimators import SocEstimator
from app.telemetry import FloatArray
from app.telemetry.measurement import Measurement

MASTER_SOC_SIGMA = 0.03  # of one number for all cells, counted on a chip


def start_estimator(
    estimator: SocEstimator,
    measured: Measurement,
    current_a: float,
    known: tuple[FloatArray, FloatArray] | None,
) -> None:
    """Start from the voltages and what agrees with them: an earlier run's SOC, or else the master's own."""
    voltages_v, degc = measured.voltage_v, measured.temperature_degc
    estimator.start(voltages_v, degc, current_a)
    by_voltage, variance = estimator.state_mean[0], estimator.state_cov[:, 0, 0]
    soc, sigma = np.full((2, *voltages_v.shape), np.nan)
    master_soc = measured.master.soc
    said = [] if master_soc is None else [(np.full_like(soc, master_soc), np.full_like(soc, MASTER_SOC_SIGMA))]
    for told_soc, told_sigma in [*said, *([] if known is None else [known])]:
        agrees = np.abs(told_soc - by_voltage) < 3.0 * np.sqrt(variance + told_sigma**2)
        soc, sigma = np.where(agrees, told_soc, soc), np.where(agrees, told_sigma, sigma)
    estimator.start(voltages_v, degc, current_a, soc, sigma)
