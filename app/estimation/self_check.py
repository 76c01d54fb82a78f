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
    counts: NDArray[np.bool_] | None,
) -> NDArray[np.bool_]:
    """Return (n,) True while the model is valid, and move the averages over `check_s` seconds on.

    The limits stand for rest and low current; at high current an error in proportion to the assumed one passes.

    Args:
        state: its `check` rows hold the averages.
        tuning: time constant and limits.
        dt_s: step [s].
        innovation_v: (n,) measured minus predicted [V].
        noise_v2: variance assumed for the model's error at this current [V^2].
        counts: (n,) False where the sample is missing or was refused: it says nothing about the model. None = all do.
    """
    check = state.check
    if counts is not None:
        innovation_v = np.where(counts, innovation_v, 0.0)
    moved = np.empty_like(check)
    np.multiply(innovation_v, tuning.model_error_v / math.sqrt(noise_v2), out=moved[0])
    np.multiply(moved[0], moved[0], out=moved[1])
    moved -= check
    moved *= 1.0 - math.exp(-dt_s / tuning.check_s)
    if counts is not None:
        moved *= counts
    check += moved
    return np.asarray((check[1] < tuning.check_rms_v**2) & (np.abs(check[0]) < tuning.check_bias_v))
