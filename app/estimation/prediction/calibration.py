"""Bands that are honest for cells nobody tuned them on: they widen while the voltage misses them and narrow while not.

Every `AHEAD_S` the voltage so much later is foretold with its band; what comes is in it or not, and the sigma of the
circuit is scaled so that one in ten misses. Source: adaptive conformal inference (Gibbs and Candes, 2021), of which
the share of misses comes to be right in the long run whatever the model's error looks like.
"""

from __future__ import annotations

from math import exp
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.prediction.constant_current import BAND_SIGMAS, CellKnowledge, OperatingPoint, voltage_sigma_v
from app.estimation.prediction.power import COVERAGE

AHEAD_S: Final = 10.0
GAIN: Final = 0.2  # a miss widens by a fifth, a hit narrows by a fiftieth
SCALE: Final = (0.8, 6.0)
LOADED_C: Final = 0.3  # at rest every band holds, which says nothing of a load
UNKNOWN_S: Final = 10.0  # what flowed in a longer gap is not known


def adapted(scale: float, missed: float, weight: float = 1.0) -> float:
    """Return the scale after a forecast that a share of the cells missed; `weight` of it where they overlap."""
    return min(max(scale * exp(GAIN * weight * (missed - (1.0 - COVERAGE))), SCALE[0]), SCALE[1])


class VoltageForecast:
    """Foretells the voltage of n cells and learns the scale of its sigma; `step` takes every sample."""

    def __init__(self, cell: CellModel, past_scale: float = 1.0) -> None:
        self.scale = past_scale
        self._cell = cell
        self._states: OperatingPoint | None = None
        self._known = CellKnowledge()
        self._left_s = 0.0

    def begin(self, states: OperatingPoint, knowledge: CellKnowledge) -> None:
        """Start from what is known now, unless a forecast is under way."""
        if self._states is not None or not np.isfinite(states.soc).any():
            return
        degc = np.where(np.isnan(states.temperature_degc), 25.0, states.temperature_degc)
        self._states, self._known, self._left_s = OperatingPoint(states.soc, states.branch_a, degc), knowledge, AHEAD_S
        self._tau_s = self._cell.time_constants(states.soc, degc)

    def step(self, dt_s: float, current_a: float, voltages_v: FloatArray) -> None:
        """Take one sample: `dt_s` since the one before, the current [A] and (n_cells,) voltages [V], NaN = missing."""
        states = self._states
        if states is None:
            return
        if dt_s > UNKNOWN_S:
            self._states = None
            return
        decay = np.exp(-dt_s / self._tau_s)
        capacity_ah = self._cell.capacity_ah if self._known.capacity_ah is None else self._known.capacity_ah
        soc = states.soc - current_a * dt_s / (SECONDS_PER_HOUR * np.asarray(capacity_ah))
        branches = decay * states.branch_a + (1.0 - decay) * current_a
        self._states = states = OperatingPoint(soc, branches, states.temperature_degc)
        self._left_s -= dt_s
        if self._left_s <= 0.0:
            self._states = None
            self._judge(states, current_a, voltages_v)

    def _judge(self, states: OperatingPoint, current_a: float, voltages_v: FloatArray) -> None:
        if abs(current_a) < LOADED_C * self._cell.capacity_ah:
            return
        cell, knowledge = self._cell, self._known
        ocv_v = cell.open_circuit_voltage(states.soc, states.temperature_degc)
        factor = np.asarray(knowledge.resistance_factor, dtype=np.float64)
        drop_v = cell.drop_v(states.soc, states.branch_a, current_a, states.temperature_degc, factor)
        current = np.full(states.n_cells, current_a)
        sigma_v = voltage_sigma_v(cell, knowledge, states, np.asarray(knowledge.soc_sigma), current, drop_v)
        off = np.abs(voltages_v - (ocv_v - drop_v)) / sigma_v
        off = off[np.isfinite(off)]
        if off.size:
            self.scale = adapted(self.scale, float((off > BAND_SIGMAS).mean()))


def scale_along(time_s: FloatArray, current_a: FloatArray, off_sigmas: FloatArray, capacity_ah: float) -> FloatArray:
    """Return the (n,) scale at every row, learned from the rows before it.

    Args:
        time_s: (n,) rising [s].
        current_a: (n,) [A].
        off_sigmas: (n,) how far the voltage was off what was foretold `AHEAD_S` before, in unscaled sigmas; NaN = not.
        capacity_ah: of the cell [Ah].
    """
    scales, scale = np.empty(time_s.size), 1.0
    weights = np.minimum(np.diff(time_s, prepend=time_s[0]) / AHEAD_S, 1.0)
    counts = np.isfinite(off_sigmas) & (np.abs(current_a) >= LOADED_C * capacity_ah)
    rows = zip(weights.tolist(), counts.tolist(), np.abs(off_sigmas).tolist(), strict=True)
    for row, (weight, count, off) in enumerate(rows):
        scales[row] = scale
        if count:
            scale = adapted(scale, float(off > BAND_SIGMAS * scale), weight)
    return scales
