"""All that a filter remembers, as rows of one array over the cells: numpy reads it as views, numba as the block."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray

SOC: Final = 0  # first row of the mean; the RC currents follow
N_SLOW: Final = 15
N_MOVING: Final = 4
(
    HYSTERESIS,
    COUNT,
    COUNT_GAIN,
    COUNT_OFFSET,
    ANCHOR_V2,
    DOUBT,
    REFUSED,
    TEMPERATURE,
    CHECK_MEAN,
    CHECK_SQUARE,
    SLOW_MEAN,
    SLOW_SQUARE,
    APART,
    WANDER,
    RESISTANCE,
) = range(N_SLOW)  # rows behind the mean and the covariance; the first N_MOVING of them move without a sample


class CellStates:
    """State of n cells with n_rc RC pairs; d = 1 + n_rc.

    Attributes:
        block: (d + d d + 15, n) everything below, one row each.
        moving: (d + d d + 4, n) its part that moves without a sample.
        gaussian: (1 + d, d, n) mean, then covariance.
        mean: (d, n) SOC, then RC currents [A].
        cov: (d, d, n) covariance.
        hysteresis: (n,) -1 after discharge .. 1 after charge.
        refused_s: (n,) how long the innovations have been refused without a break [s].
        temperature_degc: (n,) last temperature that was measured [degC].
        averages: (4, n) means of the scaled innovation [V], of its square [V^2], over a shorter time [V], and of the
            square of that [V^2].
        bias_v2: (n,) the last of them.
        wander: (2, n) mean of the filter's SOC minus the count's, and the variance that what comes on top of it shows.
        apart: (n,) its first row.
        wander_v2: (n,) its second row.
        count: (3, n) SOC by counting charge, and the sigmas that gain and offset of the sensor have given it.
        count_soc: (n,) its first row.
        drift: (2, n) its other rows.
        anchor_v2: (n,) variance of the SOC where the count began.
        doubt_s: (n,) for how long the count has been less likely than not [s].
        resistance: (n,) resistances of the cells over those of their model.
        has_resistance: whether one of them is not 1.
    """

    def __init__(self, n_rc: int, n_cells: int) -> None:
        d = 1 + n_rc
        self.n_rc = n_rc
        self.n_cells = n_cells
        self.block: FloatArray = np.zeros((d + d * d + N_SLOW, n_cells))
        slow = self.block[d + d * d :]
        self.moving = self.block[: d + d * d + N_MOVING]
        self.gaussian = self.block[: d + d * d].reshape(1 + d, d, n_cells)
        self.mean = self.block[:d]
        self.cov = self.block[d : d + d * d].reshape(d, d, n_cells)
        self.hysteresis = slow[HYSTERESIS]
        self.refused_s = slow[REFUSED]
        self.temperature_degc = slow[TEMPERATURE]
        self.averages = slow[CHECK_MEAN : SLOW_SQUARE + 1]
        self.bias_v2 = slow[SLOW_SQUARE]
        self.wander = slow[APART : WANDER + 1]
        self.apart = slow[APART]
        self.wander_v2 = slow[WANDER]
        self.count = slow[COUNT : COUNT_OFFSET + 1]
        self.count_soc = slow[COUNT]
        self.drift = slow[COUNT_GAIN : COUNT_OFFSET + 1]
        self.anchor_v2 = slow[ANCHOR_V2]
        self.doubt_s = slow[DOUBT]
        self.resistance = slow[RESISTANCE]
        self.resistance[:] = 1.0
        self.has_resistance = False
