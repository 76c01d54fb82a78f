"""A textbook extended Kalman filter on a cell file: what the product's filter has to be no worse than.

    x = [z, i_1 .. i_n],  x' = A x + B i,  A = diag(1, a_k),  B = [-dt / (3600 Q), 1 - a_k],  a_k = exp(-dt / tau_k)
    P' = A P A' + s_i^2 B B',  K = P' H' / (H P' H' + R),  x = x' + K (v - h(x')),  P = (I - K H) P'

h is the cell file's terminal voltage, H its slope. s_i is the sensor's noise, R that of the voltage and the squared
error that the identification left over. Nothing else is assumed, and nothing is learned. The voltage at the first row,
with the drop of its current, gives the SOC where none is given. Source: Plett 2004, part 3.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.recording.cell_recording import Recording
from tests.numeric.judgement import CURRENT_NOISE_C, TEMPERATURE_UNKNOWN_DEGC, VOLTAGE_NOISE_V

# mypy: disable-error-code="no-untyped-def,untyped-decorator"
# ruff: noqa: ANN001, ANN202

FloatArray = NDArray[np.float64]

GIVEN_SIGMA: Final = 0.1  # a given SOC may be wrong
UNKNOWN_SIGMA: Final = 0.2
N_SOC: Final = 1001  # table length
MARGIN: Final = 0.05  # by which the surface may lie beyond empty and full


def run(model: CellModel, recording: Recording, soc: float | None) -> FloatArray:
    """Return (n,) SOC along a recording, from a given start or from the first voltage."""
    degc = np.where(np.isnan(recording.temperature_degc), TEMPERATURE_UNKNOWN_DEGC, recording.temperature_degc)
    grid = np.linspace(-MARGIN, 1.0 + MARGIN, N_SOC)
    at = model.temperature_grid_degc[:, None]
    held = np.clip(grid, 0.0, 1.0)
    p = model.parameters(held, at)
    tables = np.array(
        [
            np.broadcast_to(table, (at.size, N_SOC))
            for table in (model.open_circuit_voltage(grid, at), p[0], p[1], model.per_reference(held, at), *p[2:4])
        ]
    )
    if model.n_rc != 2:
        raise ValueError("the reference is for two lags")
    per_a = np.zeros((2, at.size)) if model.surface_per_a is None else model.surface_per_a
    tau_s = model.time_constants(0.5, 25.0)
    noise_v2 = VOLTAGE_NOISE_V**2 + model.fit_voltage_rms_v**2
    noise_a2 = (CURRENT_NOISE_C * model.capacity_ah) ** 2
    coulomb = SECONDS_PER_HOUR * model.capacity_ah
    columns = (recording.step_s, recording.current_a, recording.voltage_v, degc)
    sigma = GIVEN_SIGMA
    if soc is None:
        soc, sigma = _from_voltage(model, columns[2][0], columns[1][0], degc[0]), UNKNOWN_SIGMA
    return np.asarray(
        _run(*columns, soc, sigma, tables, model.temperature_grid_degc, per_a, tau_s, noise_v2, noise_a2, coulomb)
    )


def _from_voltage(model: CellModel, voltage_v: float, current_a: float, degc: float) -> float:
    """Return the SOC whose voltage under a current without a past comes nearest."""
    grid = np.linspace(0.0, 1.0, N_SOC)
    at_once = model.terminal_voltage(grid, np.zeros((model.n_rc, N_SOC)), current_a, degc)
    return float(grid[np.abs(at_once - voltage_v).argmin()])


@numba.njit(cache=True)
def _output(tables, degc, temperature, per_a, z, branch, i):
    """Return the voltage of a state; tables are linear in the SOC of the surface and in temperature."""
    j, wt = 0, 0.0
    if temperature.size > 1:
        while j < temperature.size - 2 and temperature[j + 1] <= degc:
            j += 1
        wt = min(max((degc - temperature[j]) / (temperature[j + 1] - temperature[j]), 0.0), 1.0)
    up = min(j + 1, temperature.size - 1)
    for k in range(2):
        z -= (per_a[k, j] * (1.0 - wt) + per_a[k, up] * wt) * branch[k]
    n = tables.shape[2]
    place = (min(max(z, -MARGIN), 1.0 + MARGIN) + MARGIN) / (1.0 + 2.0 * MARGIN) * (n - 1)
    k = min(int(place), n - 2)
    w = place - k
    p = np.empty(6)
    for row in range(6):
        low = tables[row, j, k] * (1.0 - w) + tables[row, j, k + 1] * w
        high = tables[row, up, k] * (1.0 - w) + tables[row, up, k + 1] * w
        p[row] = low * (1.0 - wt) + high * wt
    return p[0] - p[1] * i - p[2] * np.arcsinh(i * p[3]) - p[4] * branch[0] - p[5] * branch[1]


@numba.njit(cache=True)
def _run(
    step_s, current_a, voltage_v, degc, soc, sigma, tables, temperature, per_a, tau_s, noise_v2, noise_a2, coulomb
):
    x = np.array([soc, 0.0, 0.0])
    P = np.zeros((3, 3))
    P[0, 0] = sigma * sigma
    estimate = np.empty(step_s.size)
    H, delta = np.empty(3), np.array([1e-3, 1e-2, 1e-2])
    a, B = np.ones(3), np.empty(3)
    for n in range(step_s.size):
        dt, i = step_s[n], current_a[n]
        B[0] = -dt / coulomb
        for k in range(2):
            a[k + 1] = np.exp(-dt / tau_s[k])
            B[k + 1] = 1.0 - a[k + 1]
        for u in range(3):
            x[u] = a[u] * x[u] + B[u] * i
            for w in range(3):
                P[u, w] = a[u] * P[u, w] * a[w] + noise_a2 * B[u] * B[w]
        if np.isfinite(voltage_v[n]):
            h = _output(tables, degc[n], temperature, per_a, x[0], x[1:], i)
            for u in range(3):
                kept = x[u]
                x[u] = kept + delta[u]
                above = _output(tables, degc[n], temperature, per_a, x[0], x[1:], i)
                x[u] = kept - delta[u]
                H[u] = (above - _output(tables, degc[n], temperature, per_a, x[0], x[1:], i)) / (2.0 * delta[u])
                x[u] = kept
            PH = P @ H
            S = H @ PH + noise_v2
            for u in range(3):
                x[u] += PH[u] / S * (voltage_v[n] - h)
                for w in range(3):
                    P[u, w] -= PH[u] * PH[w] / S
        estimate[n] = x[0]
    return estimate
