"""A cell of the estimator's own model along a record, without a filter: the truth of many tests."""

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel, charge_moved_coulomb
from app.estimation.errors import ModelError


def simulate(
    model: CellModel,
    time_s: FloatArray,
    current_a: FloatArray,
    temperature_degc: FloatArray,
    soc_start: float,
    trapezoidal: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return SOC and terminal voltage (n,), (n,) of one cell along a record, open loop from rest.

    Sample k's current is held from k-1 to k (as a sensor that averages delivers it), or with `trapezoidal`
    the mean of both samples counts. Any step length is exact.

    Args:
        model: the cell.
        time_s: (n,) rising time [s].
        current_a: (n,) positive on discharge [A].
        temperature_degc: (n,) [degC].
        soc_start: SOC at the first sample.
        trapezoidal: use the mean of neighbouring current samples.

    Raises:
        ModelError: time does not rise.
    """
    dt = np.diff(time_s, prepend=time_s[:1])
    if (dt < 0).any():
        raise ModelError("time_s", "runs backwards")
    held = current_a.copy()
    if trapezoidal:
        held[1:] = 0.5 * (current_a[1:] + current_a[:-1])
    soc = soc_start - np.cumsum(charge_moved_coulomb(model, held, dt)) / (SECONDS_PER_HOUR * model.capacity_ah)
    tau = model.parameters(soc, temperature_degc)[2 + model.n_rc :]
    decay = np.exp(-dt / tau)
    branch = np.empty_like(decay)
    state = np.zeros(model.n_rc)
    gain = (1.0 - decay) * held
    for k in range(time_s.size):
        state = decay[:, k] * state + gain[:, k]
        branch[:, k] = state
    hysteresis = np.zeros(time_s.size)
    if model.hysteresis_v:
        moved = np.diff(soc, prepend=soc_start)
        follow = np.exp(-model.hysteresis_rate * np.abs(moved))
        h = 0.0
        for k in range(time_s.size):
            h = follow[k] * h + (1.0 - follow[k]) * np.sign(moved[k])
            hysteresis[k] = h
    return soc, model.terminal_voltage(soc, branch, current_a, temperature_degc, hysteresis)
