"""A small numerical tool of the identification: a long first-order recursion."""

from __future__ import annotations

import numpy as np

from app.estimation.arrays import FloatArray


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
