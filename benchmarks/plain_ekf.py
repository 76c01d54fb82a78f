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
POINTS = 1001  # of the cell file over SOC: looked up in tables, for speed
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
    table, tau_s = _table(cell)
    row, share = _between(degc, np.asarray(cell.temperature_grid_degc, np.float64))
    over, is_missing = np.arcsinh(current_a / cell.overpotential_current_a), np.isnan(voltage_v)
    B, H = np.empty(d), np.empty((n, d))
    for k, (dt, i, v) in enumerate(zip(dt_s.tolist(), current_a, voltage_v, strict=True)):
        A = np.append(1.0, np.exp(-dt / tau_s))
        B[0], B[1:] = -dt / (3600.0 * cell.capacity_ah), 1.0 - A[1:]
        x = A * x + B * i[:, None]
        P = P * (A[:, None] * A) + (B[:, None] * B) * (CURRENT_SIGMA_C * cell.capacity_ah) ** 2
        P[:, 0, 0] += SOC_WALK**2 * dt
        p = _look_up(table, x[:, 0], row[k], share[k])
        slope_v, r0, e, r = p[1], p[2], p[3], p[4:].T
        H[:, 0], H[:, 1:] = slope_v, -r
        ocv_v = p[0] + slope_v * (x[:, 0] - np.minimum(np.maximum(x[:, 0], 0.0), 1.0))
        predicted = ocv_v - r0 * i - e * over[k] - (r * x[:, 1:]).sum(axis=1)
        PH = (P * H[:, None]).sum(axis=2)
        K = PH / ((H * PH).sum(axis=1) + VOLTAGE_SIGMA_V**2)[:, None]
        K[is_missing[k]] = 0.0
        x = x + K * np.where(is_missing[k], 0.0, v - predicted)[:, None]
        P = P - K[:, :, None] * PH[:, None, :]
        x[:, 0] = np.minimum(np.maximum(x[:, 0], -0.05), 1.05)
        found[0, k], found[1, k] = x[:, 0], np.sqrt(P[:, 0, 0])
    return np.clip(found[0], 0.0, 1.0), found[1]


def _table(cell: CellModel) -> tuple[FloatArray, FloatArray]:
    """Return (n_temperatures, POINTS, 4 + n_rc) OCV, slope, R0, overpotential, RC resistances; (n_rc,) taus."""
    soc, n = np.linspace(0.0, 1.0, POINTS), 2 + cell.n_rc
    rows = []
    for degc in cell.temperature_grid_degc:
        circuit = cell.parameters(soc, np.full(POINTS, degc))[:n]
        rows.append(np.array((cell.ocv.voltage(soc), cell.ocv.slope(soc), *circuit)).T)
    return np.array(rows), np.asarray(cell.parameters(0.5, 25.0)[n:])


def _between(values: FloatArray, grid: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the point of a grid below each value, and its share of the way to the next one, held at the ends."""
    if grid.size == 1:
        return np.zeros(values.shape, np.intp), np.zeros(values.shape)
    below = np.clip(np.searchsorted(grid, values, side="right") - 1, 0, grid.size - 2)
    return below, np.clip((values - grid[below]) / (grid[below + 1] - grid[below]), 0.0, 1.0)


def _look_up(table: FloatArray, soc: FloatArray, row: NDArray[np.intp], share: FloatArray) -> FloatArray:
    """Return (4 + n_rc, n) what the table holds at a SOC, linear between points and temperatures."""
    place = np.minimum(np.maximum(soc, 0.0), 1.0) * (POINTS - 1)
    point = np.minimum(place.astype(np.intp), POINTS - 2)
    part = (place - point)[:, None]
    cold = table[row, point] + part * (table[row, point + 1] - table[row, point])
    if len(table) == 1:
        return np.asarray(cold.T)
    warm = table[row + 1, point] + part * (table[row + 1, point + 1] - table[row + 1, point])
    return np.asarray((cold + share[:, None] * (warm - cold)).T)
