"""The judge: the extended Kalman filter of a textbook on the same cell file, for two RC pairs, nothing added.

States are SOC and the currents through the RC resistors; white noise on voltage and current, one tuning for all cells.
Source: Plett, J. Power Sources 134 (2004) 277. It shares the cell file with the product and not a line of its filters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.estimation.cell_model.circuit import CellModel

FloatArray = NDArray[np.float64]

VOLTAGE_SIGMA_V = 0.01  # of model and sensor, white
CURRENT_SIGMA_C = 0.02  # likewise
SOC_SIGMA = 0.1  # of the start
SOC_WALK = 3e-6  # per square root of a second


def plain_ekf(
    cell: CellModel, dt_s: FloatArray, current_a: FloatArray, voltage_v: FloatArray, degc: FloatArray, soc: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return (n_steps, n) SOC and sigma of n runs side by side.

    Args:
        cell: the cell model; its hysteresis and time constants over SOC are left out.
        dt_s: (n_steps,) time since the sample before [s].
        current_a: (n_steps, n) positive on discharge [A].
        voltage_v: (n_steps, n) [V].
        degc: (n_steps, n) [degC].
        soc: (n,) or scalar, at the first sample.
    """
    n, d = voltage_v.shape[1], 1 + cell.n_rc
    x, P, found = np.zeros((n, d)), np.zeros((n, d, d)), np.empty((2, *voltage_v.shape))
    x[:, 0] = soc
    P[:, 0, 0] = SOC_SIGMA**2
    tau_s = cell.parameters(0.5, 25.0)[2 + cell.n_rc :]
    B, H = np.empty(d), np.empty((n, d))
    for k, (dt, i, v, t) in enumerate(zip(dt_s.tolist(), current_a, voltage_v, degc, strict=True)):
        A = np.append(1.0, np.exp(-dt / tau_s))
        B[0], B[1:] = -dt / (3600.0 * cell.capacity_ah), 1.0 - A[1:]
        x = A * x + B * i[:, None]
        P = A[:, None] * P * A + np.outer(B, B) * (CURRENT_SIGMA_C * cell.capacity_ah) ** 2
        P[:, 0, 0] += SOC_WALK**2 * dt
        p = cell.parameters(np.clip(x[:, 0], 0.0, 1.0), t)
        r0, e, r = p[0], p[1], p[2 : 2 + cell.n_rc].T
        H[:, 0], H[:, 1:] = cell.ocv.slope(np.clip(x[:, 0], 0.0, 1.0)), -r
        predicted = cell.ocv.voltage(x[:, 0]) - r0 * i - e * np.arcsinh(i / cell.overpotential_current_a)
        PH = np.einsum("nij,nj->ni", P, H)
        K = PH / (np.einsum("ni,ni->n", H, PH) + VOLTAGE_SIGMA_V**2)[:, None]
        innovation = np.where(np.isnan(v), 0.0, v - (predicted - (r * x[:, 1:]).sum(axis=1)))
        x = x + K * innovation[:, None]
        P = P - np.where(np.isnan(v), 0.0, 1.0)[:, None, None] * K[:, :, None] * PH[:, None, :]
        x[:, 0] = np.clip(x[:, 0], -0.05, 1.05)
        found[0, k], found[1, k] = x[:, 0], np.sqrt(P[:, 0, 0])
    return np.clip(found[0], 0.0, 1.0), found[1]
