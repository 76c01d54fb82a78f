"""Two small numerical tools of the identification: a long first-order recursion and non-negative least squares."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.estimation.errors import EstimatorError

ITERATIONS_PER_UNKNOWN: Final = 10


def first_order(decay: FloatArray, drive: FloatArray) -> FloatArray:
    """Return y with y[k] = decay[k] y[k-1] + drive[k], starting from rest, without a loop over the samples.

    Blocks of about sqrt(n) samples run side by side, then each block gets the end of the one before.

    Args:
        decay: (n,) factors in 0..1.
        drive: (n,) inputs.

    Returns:
        (n,) outputs, equal to the plain recursion up to rounding.
    """
    n = drive.size
    length = max(int(np.ceil(np.sqrt(n))), 1)
    blocks = -(-n // length)
    factors, inputs = np.ones((2, blocks * length))
    factors[:n] = decay
    inputs[:n] = drive
    inputs[n:] = 0.0
    factors_by_step = np.ascontiguousarray(factors.reshape(blocks, length).T)
    outputs = np.ascontiguousarray(inputs.reshape(blocks, length).T)
    reach = factors_by_step.copy()
    for k in range(1, length):
        outputs[k] += factors_by_step[k] * outputs[k - 1]
        reach[k] *= reach[k - 1]
    carry = np.zeros(blocks)
    for b in range(1, blocks):
        carry[b] = reach[-1, b - 1] * carry[b - 1] + outputs[-1, b - 1]
    outputs += reach * carry
    return outputs.T.reshape(-1)[:n].copy()


def non_negative_least_squares(gram: FloatArray, moment: FloatArray, is_free: NDArray[np.bool_]) -> FloatArray:
    """Return x that minimises x' G x - 2 c' x with x >= 0 except where free.

    Args:
        gram: (n, n) symmetric positive definite G = A' W A.
        moment: (n,) c = A' W y.
        is_free: (n,) True where x may be negative.

    Raises:
        EstimatorError: the iteration does not end, which a positive definite G rules out.

    Source: Lawson and Hanson, Solving Least Squares Problems, 1974, ch. 23, on the normal equations.
    """
    n = moment.size
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    G, c = gram * scale[:, None] * scale, moment * scale
    # whatever is positive without the constraint begins in the passive set: any feasible start leads to the minimum
    passive = np.ones(n, dtype=np.bool_)
    x = _solve_passive(G, c, passive)
    while (negative := passive & ~is_free & (x < 0.0)).any():
        passive &= ~negative
        x = _solve_passive(G, c, passive)
    tolerance = 1e-10 * max(float(np.abs(c).max()), 1e-300)
    for _ in range(ITERATIONS_PER_UNKNOWN * n + 1):
        gradient = np.where(passive, -np.inf, c - G @ x)
        worst = int(np.argmax(gradient))
        if gradient[worst] <= tolerance:
            return np.asarray(x * scale)
        passive[worst] = True
        while True:
            trial = _solve_passive(G, c, passive)
            negative = passive & ~is_free & (trial <= 0.0)
            if not negative.any():
                x = trial
                break
            ratio = np.full(n, np.inf)
            ratio[negative] = x[negative] / np.maximum(x[negative] - trial[negative], 1e-300)
            x = x + ratio.min() * (trial - x)
            passive[negative & (ratio <= ratio.min() * (1.0 + 1e-12))] = False
            x[~passive] = 0.0
    raise EstimatorError("non-negative least squares did not end: the design is degenerate")


def _solve_passive(G: FloatArray, c: FloatArray, passive: NDArray[np.bool_]) -> FloatArray:
    x = np.zeros_like(c)
    rows = np.flatnonzero(passive)
    if rows.size:
        x[rows] = np.linalg.solve(G[np.ix_(rows, rows)], c[rows])
    return x
