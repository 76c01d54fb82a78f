"""Scores a run of SOC estimates against a reference: how far off, how soon settled, how honest the sigma."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray

SETTLING_S: Final = 60.0  # what comes before is start-up and judged by the settling times alone


@dataclass(frozen=True)
class SocScore:
    """Scores of one run; SOC errors are fractions of the capacity.

    Attributes:
        soc_rmse: root mean square error over all scored rows.
        soc_bias: mean of estimate minus reference.
        soc_max_error_after_60s: largest magnitude from 60 s after the start; NaN for shorter runs.
        settle_5_s, settle_2_s: seconds from the start until the error stays within 5 % and 2 %; None = never.
        inside_3_sigma: share of the rows whose error lies within three sigma.
        sigma_rms: root mean square sigma; beside the RMSE of many runs it shows whether sigma is too wide.
        nees: mean of (error / sigma)^2; 1 where sigma tells the truth.
    """

    soc_rmse: float
    soc_bias: float
    soc_max_error_after_60s: float
    settle_5_s: float | None
    settle_2_s: float | None
    inside_3_sigma: float
    sigma_rms: float
    nees: float


def score_soc(time_s: FloatArray, soc: FloatArray, soc_sigma: FloatArray, reference_soc: FloatArray) -> SocScore | None:
    """Return the scores of estimates against a reference, None where no row has both.

    Args:
        time_s: (n,) time, not falling [s]; the run starts at the first row.
        soc: (n,) estimate.
        soc_sigma: (n,) its standard deviation.
        reference_soc: (n,) reference, NaN where unknown.
    """
    known = np.isfinite(reference_soc) & np.isfinite(soc)
    if not known.any():
        return None
    elapsed_s = (time_s - time_s[0])[known]
    error = (soc - reference_soc)[known]
    sigma = np.maximum(soc_sigma[known], 1e-12)
    late = np.abs(error[elapsed_s >= SETTLING_S])
    return SocScore(
        soc_rmse=float(np.sqrt(np.mean(error**2))),
        soc_bias=float(np.mean(error)),
        soc_max_error_after_60s=float(late.max()) if late.size else float("nan"),
        settle_5_s=settling_time(elapsed_s, error, 0.05),
        settle_2_s=settling_time(elapsed_s, error, 0.02),
        inside_3_sigma=float(np.mean(np.abs(error) <= 3.0 * sigma)),
        sigma_rms=float(np.sqrt(np.mean(sigma**2))),
        nees=float(np.mean((error / sigma) ** 2)),
    )


def settling_time(elapsed_s: FloatArray, error: FloatArray, bound: float) -> float | None:
    """Return the first time [s] from which on |error| stays within the bound, None if the run ends outside it."""
    outside = np.flatnonzero(np.abs(error) > bound)
    if outside.size == 0:
        return 0.0
    first_inside = int(outside[-1]) + 1
    return float(elapsed_s[first_inside]) if first_inside < elapsed_s.size else None
