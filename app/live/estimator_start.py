"""Start of an estimator with a measurement: from voltages, an earlier run's SOC, the master's own."""

import numpy as np

from app.estimation.filters.estimators import SocEstimator
from app.live.remembered_charge import MASTER_SOC_SIGMA, RememberedCharge
from app.telemetry.measurement import Measurement


def start_estimator(
    estimator: SocEstimator,
    measured: Measurement,
    current_a: float,
    remembered: RememberedCharge | None,
) -> None:
    """Start from the voltages and what agrees with them: an earlier run's SOC, or else the master's own."""
    voltages_v, degc = measured.voltage_v, measured.temperature_degc
    estimator.start(voltages_v, degc, current_a)
    by_voltage, variance = estimator.state_mean[0], estimator.state_cov[:, 0, 0]
    soc, sigma = np.full((2, *voltages_v.shape), np.nan)
    master_soc = measured.master.soc
    starts = [] if master_soc is None else [(np.full_like(soc, master_soc), np.full_like(soc, MASTER_SOC_SIGMA))]
    if remembered is not None:
        starts.append(remembered.at(measured, estimator.capacity()[0], estimator.tuning))
    for known_soc, known_sigma in starts:
        agrees = np.abs(known_soc - by_voltage) < 3.0 * np.sqrt(variance + known_sigma**2)
        soc, sigma = np.where(agrees, known_soc, soc), np.where(agrees, known_sigma, sigma)
    estimator.start(voltages_v, degc, current_a, soc, sigma)
