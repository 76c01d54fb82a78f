"""The filter of SPKF-2020 as its script writes it: eleven points, one Cholesky factor a cell, nothing simplified.

State [SOC, V_short, V_long], Euler discretisation, process noise the same in all three states, the voltage looked up
in curves under load. Needs numba, of the group `bench`; kept apart from the product, which does not compute like this.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from simulator.loads import PATTERNS_C

# mypy: disable-error-code="no-untyped-def,untyped-decorator"
# ruff: noqa: ANN001, ANN201, RUF046

FloatArray = NDArray[np.float64]

STEP_S: Final = 290e-6
CAPACITY_AH: Final = 25.0
R_SERIES, R_SHORT, C_SHORT, R_LONG, C_LONG = 2.7e-6, 2e-3, 500.0, 1.1e-3, 5000.0
P0, PROCESS_NOISE, VOLTAGE_NOISE = (1.7, 0.04, 0.04), 1e-3, 0.04


def pattern(name: str) -> FloatArray:
    """Return the load of each slice [C]."""
    return np.array(PATTERNS_C[name], dtype=float)


@numba.njit(cache=True)
def run(mean, cov, current_a, volts, curves, spread, w_mean0, w_cov0, weight, keep_every, kept):
    """Filter (steps,) currents and (steps, n) voltages; `mean` (n, 3) and `cov` (n, 3, 3) are written in place.

    `kept` (n_kept, n) receives the SOC of every `keep_every`-th pass.
    """
    capacity = CAPACITY_AH * 3600.0
    phi = np.array([1.0, 1.0 - STEP_S / (R_SHORT * C_SHORT), 1.0 - STEP_S / (R_LONG * C_LONG)])
    gamma = np.array([-STEP_S / capacity, STEP_S / C_SHORT, STEP_S / C_LONG])
    root_q, root_r = np.sqrt(PROCESS_NOISE), np.sqrt(VOLTAGE_NOISE)
    X = np.empty((3, 11))
    Y = np.empty(11)
    L = np.zeros((5, 5))
    x, Pxy, new = np.empty(3), np.empty(3), np.empty((3, 3))
    for k in range(current_a.size):
        i = current_a[k]
        curve = curves[min(max(int(round(abs(i) / CAPACITY_AH)), 1), 10) - 1]
        for c in range(mean.shape[0]):
            P = cov[c]
            for a in range(3):
                for b in range(a + 1):
                    s = P[a, b]
                    for q in range(b):
                        s -= L[a, q] * L[b, q]
                    L[a, b] = np.sqrt(s) if a == b else s / L[b, b]
            L[3, 3], L[4, 4] = root_q, root_r
            for point in range(11):
                column = (point - 1) % 5
                sign = 0.0 if point == 0 else (spread if point < 6 else -spread)
                noise = sign * L[3, column]
                for a in range(3):
                    X[a, point] = phi[a] * (mean[c, a] + sign * L[a, column]) + gamma[a] * i + noise
                at = min(max(X[0, point], 0.0), 1.0) * 1000.0
                j = min(int(at), 999)
                voc = curve[j] + (at - j) * (curve[j + 1] - curve[j])
                Y[point] = voc - X[1, point] - X[2, point] - R_SERIES * i + sign * L[4, column]
            y = w_mean0 * Y[0]
            for point in range(1, 11):
                y += weight * Y[point]
            for a in range(3):
                x[a] = w_mean0 * X[a, 0]
                for point in range(1, 11):
                    x[a] += weight * X[a, point]
            Py = 0.0
            Pxy[:] = 0.0
            new[:] = 0.0
            for point in range(11):
                w = w_cov0 if point == 0 else weight
                Py += w * (Y[point] - y) ** 2
                for a in range(3):
                    Pxy[a] += w * (X[a, point] - x[a]) * (Y[point] - y)
                    for b in range(3):
                        new[a, b] += w * (X[a, point] - x[a]) * (X[b, point] - x[b])
            for a in range(3):
                mean[c, a] = x[a] + Pxy[a] / Py * (volts[k, c] - y)
                for b in range(3):
                    cov[c, a, b] = new[a, b] - Pxy[a] * Pxy[b] / Py
            if k % keep_every == 0:
                kept[k // keep_every, c] = mean[c, 0]
