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
        sigma_rms: root mean square sigma; with the RMSE of many runs it shows whether sigma is too wide.
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
    is_finite = np.isfinite(reference_soc) & np.isfinite(soc)
    if not is_finite.any():
        return None
    elapsed_s = (time_s - time_s[0])[is_finite]
    error = (soc - reference_soc)[is_finite]
    sigma = np.maximum(soc_sigma[is_finite], 1e-12)
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


LAGS: Final = 20  # autocorrelations that are judged, in rows
ROWS_MIN: Final = 10 * LAGS  # fewer say nothing
BOUND_95: Final = 1.96  # bound of the autocorrelation of white noise, over sqrt(n)
LASTING_S: Final = 300.0  # no correlation is followed further


@dataclass(frozen=True)
class InnovationScore:
    """Statistics of the normalised innovations y = nu / sigma_nu of a run.

    Attributes:
        nis: mean of y^2; 1 where the filter expects the innovations it gets.
        innovation_white_share: share of the first 20 autocorrelations within the 95 % bound of white noise.
            0.95 if white.
        innovation_ljung_box: Ljung-Box statistic over 20 lags, per lag; about 1 if white.
        innovation_correlation_s: how long an innovation lasts: integral of the autocorrelation up to where it first
            falls to 0.05, both sides; about one sampling step if white [s].
    """

    nis: float
    innovation_white_share: float
    innovation_ljung_box: float
    innovation_correlation_s: float


def score_innovations(time_s: FloatArray, innovation_v: FloatArray, sigma_v: FloatArray) -> InnovationScore | None:
    """Return the scores of a run, None with fewer than 200 innovations.

    Lags are counted in rows: gaps and changes of the sampling are passed over.

    Args:
        time_s: (n,) time, not falling [s].
        innovation_v: (n,) measured minus predicted [V], NaN where nothing was measured.
        sigma_v: (n,) what the filter expects of it, > 0 [V].

    Source: G. M. Ljung and G. E. P. Box, Biometrika 65 (1978), on normalised innovations.
    """
    is_finite = np.isfinite(innovation_v) & np.isfinite(sigma_v) & (sigma_v > 0.0)
    n = int(is_finite.sum())
    if n < ROWS_MIN:
        return None
    y = np.where(is_finite, innovation_v, 0.0) / np.where(is_finite, sigma_v, 1.0)
    step_s = float(np.median(np.diff(time_s)))
    longest = min(max(LAGS, round(LASTING_S / step_s) if step_s > 0.0 else LAGS), time_s.size - 1)
    r = autocorrelation(y, longest)
    lags = np.arange(1, LAGS + 1)
    near = r[1 : LAGS + 1]
    faded = np.flatnonzero(r < 0.05)
    last = int(faded[0]) if faded.size else longest
    return InnovationScore(
        nis=float(np.sum(y**2) / n),
        innovation_white_share=float(np.mean(np.abs(near) <= BOUND_95 / np.sqrt(n))),
        innovation_ljung_box=float(n * (n + 2.0) * np.sum(near**2 / (n - lags)) / LAGS),
        innovation_correlation_s=step_s * float(2.0 * np.sum(r[:last]) - 1.0),
    )


def autocorrelation(values: FloatArray, longest: int) -> FloatArray:
    """Return the (longest + 1,) autocorrelation at lags 0, 1, ..; mean not removed: a bias is not white.

    Args:
        values: (n,) finite; n > longest.
        longest: the last lag.
    """
    size = 1 << int(2 * values.size - 1).bit_length()
    power = np.abs(np.fft.rfft(values, size)) ** 2
    moments = np.fft.irfft(power, size)[: longest + 1]
    return np.asarray(moments / max(float(moments[0]), 1e-300))
