"""Does the model describe this cell? Slow averages of the innovation and of its square answer per cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]


class SelfCheck:
    """Running mean and mean square of the innovations of n cells, each over `check_s` seconds."""

    def __init__(self, n_cells: int, tuning: Tuning) -> None:
        self._tuning = tuning
        self.moments = np.zeros((2, n_cells))

    def step(self, dt_s: float, innovation_v: FloatArray, model_v2: float) -> NDArray[np.bool_]:
        """Return (n,) True while the model is valid.

        The limits stand for rest and low current; at high current an error in proportion to the assumed one passes.

        Args:
            dt_s: step [s].
            innovation_v: (n,) measured minus predicted [V], NaN = no sample, which changes nothing.
            model_v2: variance assumed for the model's error at this current [V^2].
        """
        tuning = self._tuning
        weight = 1.0 - tuning.charge_decay(dt_s, tuning.check_s)
        scale = tuning.model_error_v / model_v2**0.5
        scaled = np.where(np.isnan(innovation_v), self.moments[0], innovation_v * scale)
        square = np.where(np.isnan(innovation_v), self.moments[1], scaled * scaled)
        self.moments[0] += weight * (scaled - self.moments[0])
        self.moments[1] += weight * (square - self.moments[1])
        return np.asarray((self.moments[1] < tuning.check_rms_v**2) & (np.abs(self.moments[0]) < tuning.check_bias_v))
