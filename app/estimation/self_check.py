"""Does the model describe this cell? Slow averages of the innovation and of its square answer per cell."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from app.estimation.states import CellStates
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]


def check_model(
    state: CellStates,
    tuning: Tuning,
    dt_s: float,
    innovation_v: FloatArray,
    noise_v2: float,
    counts: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return (n,) True while the model is valid, and move the averages over `check_s` seconds on.

    The limits stand for rest and low current; at high current an error in proportion to the assumed one passes.

    Args:
        state: its `check` rows hold the averages.
        tuning: time constant and limits.
        dt_s: step [s].
        innovation_v: (n,) measured minus predicted [V].
        noise_v2: variance assumed for the model's error at this current [V^2].
        counts: (n,) False where the sample is missing or was refused: it says nothing about the model.
    """
    weight = 1.0 - math.exp(-dt_s / tuning.check_s)
    mean, square = state.check
    scaled = innovation_v * (tuning.model_error_v / math.sqrt(noise_v2))
    if counts.all():
        mean += weight * (scaled - mean)
        square += weight * (scaled * scaled - square)
    else:
        mean[counts] += weight * (scaled[counts] - mean[counts])
        square[counts] += weight * (scaled[counts] ** 2 - square[counts])
    return np.asarray((square < tuning.check_rms_v**2) & (np.abs(mean) < tuning.check_bias_v))
