"""Textbook sigma-point filters, one cell at a time: what the marginalised forms must equal.

Nothing is exploited here: every point is drawn with a Cholesky factor, sent through process and output, and
summed with its weight. Slow on purpose, for tests and for the benchmark's comparison.
Source: van der Merwe 2004; the augmented set is the one of SPKF-2020.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from app.estimation.filters.sigma_points import SigmaRule

FloatArray = NDArray[np.float64]
Process = Callable[[FloatArray, float], FloatArray]
Output = Callable[[FloatArray], float]


def additive_step(
    mean: FloatArray,
    cov: FloatArray,
    rule: SigmaRule,
    process: Process,
    process_noise_cov: FloatArray,
    output: Output,
    noise_v2: float,
    measured_v: float,
) -> tuple[FloatArray, FloatArray]:
    """Return mean (d,) and covariance (d, d) after one step with additive noise: 2 d + 1 points, drawn twice.

    Args:
        mean: (d,) before the step, SOC first.
        cov: (d, d) before the step.
        rule: spread and weights for d dimensions.
        process: state and current noise [A] -> state after the step; the noise is 0 here.
        process_noise_cov: (d, d) added after the process.
        output: state -> terminal voltage [V].
        noise_v2: variance of the measurement [V^2].
        measured_v: terminal voltage [V].

    Raises:
        numpy.linalg.LinAlgError: a covariance is not positive definite.
    """
    weights_mean, weights_cov = _weights(rule)
    points = np.array([process(p, 0.0) for p in _points(mean, cov, rule)])
    mean = weights_mean @ points
    spread = points - mean
    cov = (weights_cov * spread.T) @ spread + process_noise_cov
    points = _points(mean, cov, rule)
    outputs = np.array([output(p) for p in points])
    predicted = weights_mean @ outputs
    innovation_cov = weights_cov @ (outputs - predicted) ** 2 + noise_v2
    cross = (weights_cov * (outputs - predicted)) @ (points - mean)
    gain = cross / innovation_cov
    return mean + gain * (measured_v - predicted), cov - innovation_cov * np.outer(gain, gain)


def augmented_step(
    mean: FloatArray,
    cov: FloatArray,
    rule: SigmaRule,
    process: Process,
    current_noise_a2: float,
    output: Output,
    noise_v2: float,
    measured_v: float,
) -> tuple[FloatArray, FloatArray]:
    """Return mean (d,) and covariance (d, d) after one step of the augmented filter: 2 (d + 2) + 1 points, drawn once.

    The state is augmented with the noise of the current (inside the process) and of the voltage.

    Args:
        mean: (d,) before the step, SOC first.
        cov: (d, d) before the step.
        rule: spread and weights for d + 2 dimensions.
        process: state and current noise [A] -> state after the step.
        current_noise_a2: variance of the current noise [A^2], > 0.
        output: state -> terminal voltage [V].
        noise_v2: variance of the measurement [V^2], > 0.
        measured_v: terminal voltage [V].

    Raises:
        numpy.linalg.LinAlgError: a covariance is not positive definite.
    """
    d = mean.size
    weights_mean, weights_cov = _weights(rule)
    wide_cov = np.zeros((d + 2, d + 2))
    wide_cov[:d, :d] = cov
    wide_cov[d, d] = current_noise_a2
    wide_cov[d + 1, d + 1] = noise_v2
    drawn = _points(np.concatenate((mean, [0.0, 0.0])), wide_cov, rule)
    points = np.array([process(p[:d], p[d]) for p in drawn])
    mean = weights_mean @ points
    cov = (weights_cov * (points - mean).T) @ (points - mean)
    outputs = np.array([output(p) for p in points]) + drawn[:, d + 1]
    predicted = weights_mean @ outputs
    innovation_cov = weights_cov @ (outputs - predicted) ** 2
    gain = (weights_cov * (outputs - predicted)) @ (points - mean) / innovation_cov
    return mean + gain * (measured_v - predicted), cov - innovation_cov * np.outer(gain, gain)


def _points(mean: FloatArray, cov: FloatArray, rule: SigmaRule) -> FloatArray:
    columns = rule.spread * np.linalg.cholesky(cov).T
    return np.concatenate((mean[None], mean + columns, mean - columns))


def _weights(rule: SigmaRule) -> tuple[FloatArray, FloatArray]:
    mean = np.full(2 * rule.n_dim + 1, rule.weight)
    cov = mean.copy()
    mean[0], cov[0] = rule.centre_mean, rule.centre_cov
    return mean, cov
