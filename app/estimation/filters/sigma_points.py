"""Spread and weights of the sigma points, for the marginalised filter and the textbook filters of the tests.

A symmetric set of L dimensions has a centre and L pairs at +-c columns of the Cholesky factor, weight 1/(2 c^2).
Source: Julier and Uhlmann (scaled unscented transform) in SPKF-2020; central differences in EKF-CDKF-2022.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SigmaRule:
    """A symmetric sigma-point rule.

    Attributes:
        n_dim: dimensions of the set, L.
        spread: c, in standard deviations.
        weight: of every point but the centre, in mean and covariance.
        centre_mean: weight of the centre in the mean.
        centre_cov: weight of the centre in the covariance.
    """

    n_dim: int
    spread: float
    weight: float
    centre_mean: float
    centre_cov: float

    @property
    def curvature(self) -> float:
        """Factor k of the variance that curvature along one direction adds: k (h+ + h- - 2 h0)^2; never negative.

        With q = h+ + h- - 2 h0 the mean moves by w q, and the centre and the L - 1 straight pairs then lie at -w q:
        (W_c + 2 (L-1) w) w^2 q^2 + 2 w (1/2 - w)^2 q^2 = k q^2.
        """
        w = self.weight
        return (self.centre_cov + 2.0 * (self.n_dim - 1) * w) * w * w + 2.0 * w * (0.5 - w) ** 2


def unscented(n_dim: int, alpha: float = 0.1, beta: float = 2.0, kappa: float = 0.0) -> SigmaRule:
    """Return the scaled unscented rule: c^2 = alpha^2 (L + kappa)."""
    c2 = alpha * alpha * (n_dim + kappa)
    mean = (c2 - n_dim) / c2
    return SigmaRule(n_dim, c2**0.5, 0.5 / c2, mean, mean + 1.0 - alpha * alpha + beta)


def central_difference(n_dim: int, step: float = 3.0**0.5) -> SigmaRule:
    """Return the central-difference rule: c = h, one set of weights."""
    h2 = step * step
    mean = (h2 - n_dim) / h2
    return SigmaRule(n_dim, step, 0.5 / h2, mean, mean)
