"""The thesis's augmented sigma-point filter, marginalised: five look-ups give the numbers of its eleven points.

Its set is drawn once, over state, current noise and voltage noise, and is not drawn again after the process. Two
directions see another SOC: the first Cholesky column of the state, and the current noise. The rest lies straight:

    P'   = A P A' + s_w^2 B B'
    y    = h0 + w (q_z + q_w)                                      q = h+ + h- - 2 h0 along a direction
    P_xy = w c (A S_1 (h+ - h-) + B s_w (h_w+ - h_w-)) + A P_c A g
    P_yy = (W_c + 2 w (L - 2)) (h0 - y)^2 + w sum (h - y)^2 + g A P_c A g + R      P_c = P - P_xz P_zx / P_zz

Source: SPKF-2020 for the filter; the closed form is derived from its points.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from app.estimation.filters.sigma_points import SigmaRule

FloatArray = NDArray[np.float64]
OutputOfPoints = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def marginal_augmented_step(
    mean: FloatArray,
    cov: FloatArray,
    rule: SigmaRule,
    decay: FloatArray,
    gain_per_a: FloatArray,
    current_a: float,
    current_noise_a: float,
    output: OutputOfPoints,
    noise_v2: float,
    measured_v: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return mean (d, n) and covariance (d, d, n) of n cells after one step.

    Args:
        mean: (d, n) before the step, SOC first.
        cov: (d, d, n) before the step.
        rule: spread and weights for d + 2 dimensions.
        decay: (d,) A: 1 for SOC, exp(-dt / tau) for the rest.
        gain_per_a: (d,) B: change of the state for 1 A [1/A, A/A].
        current_a: positive on discharge [A].
        current_noise_a: standard deviation s_w of the current [A].
        output: (d, k, n) states -> (k, n) voltages [V] and (d - 1, n) slope g with the rest, at the first of the k.
        noise_v2: variance of the voltage [V^2].
        measured_v: (n,) [V].
    """
    A, B = decay[:, None], gain_per_a[:, None]
    c, w = rule.spread, rule.weight
    first = A * cov[0] / np.sqrt(cov[0, 0])
    straight = A[:, None] * cov * A - first[:, None] * first  # A P_c A'
    noise = np.broadcast_to(B * current_noise_a, first.shape)
    x = A * mean + B * current_a
    P = straight + first[:, None] * first + noise[:, None] * noise
    h, g = output(np.stack((x, x + c * first, x - c * first, x + c * noise, x - c * noise), axis=1))
    y = h[0] + w * (h[1:].sum(axis=0) - 4.0 * h[0])
    Pg = (straight[:, 1:] * g).sum(axis=1)
    Pxy = w * c * (first * (h[1] - h[2]) + noise * (h[3] - h[4])) + Pg
    centre = rule.centre_cov + 2.0 * w * (rule.n_dim - 2)
    S = centre * (h[0] - y) ** 2 + w * ((h[1:] - y) ** 2).sum(axis=0) + (g * Pg[1:]).sum(axis=0) + noise_v2
    K = Pxy / S
    return x + K * (measured_v - y), P - S * (K[:, None] * K)
