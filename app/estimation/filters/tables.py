"""A cell model laid out for look-ups of many cells at once: even SOC grid, one row for each coefficient.

Values between grid points are linear in SOC and temperature. The filters, fast or textbook, all read the cell
through this class, so that they differ in nothing but their algebra.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray, IntArray
from app.estimation.cell_model.circuit import CellModel

SOC_LOW: Final = -0.1  # the tables reach past 0 and 1, because sigma points do; beyond them values hold
SOC_STEP: Final = 0.001
N_SOC: Final = 1201
R0, BRANCH = range(2)  # rows of the circuit table: R0, R_1 .. R_m, and e where the cell has one


class PackedCell:
    """Tables of one cell model.

    Attributes:
        ocv: (2, N_SOC) value at the grid point and difference to the next [V].
        ocv_slope: (2, N_SOC) dOCV/dSOC, likewise; with a smoothed OCV this is the smoothed slope [V].
        circuit: (4, 1 + n_rc, n_t * N_SOC) value, difference in SOC, in temperature, and in both, of R0 and R_k;
            e follows as one more row where the cell has an overpotential.
        has_overpotential: False where e is 0 everywhere.
        tau_s: (n_rc, n_t, N_SOC) [s].
        tau_fixed_s: (n_rc,) when every time constant is the same at any SOC and temperature, else None [s].
    """

    def __init__(self, model: CellModel) -> None:
        self.model = model
        soc = SOC_LOW + SOC_STEP * np.arange(N_SOC)
        self._soc = soc
        self.ocv = _with_difference(model.ocv.voltage(soc))
        self.ocv_slope = _with_difference(model.ocv.slope(soc))
        self.has_overpotential = bool(np.any(model.overpotential_v))
        self.temperature_grid_degc = model.temperature_grid_degc
        self.n_t = model.temperature_grid_degc.size
        values = model.parameters(soc[None, :], self.temperature_grid_degc[:, None])
        circuit = np.concatenate((values[:1], values[2 : 2 + model.n_rc], values[1:2]))
        if not self.has_overpotential:
            circuit = circuit[:-1]
        by_soc = np.diff(circuit, axis=2, append=circuit[:, :, -1:])
        by_temperature = np.diff(circuit, axis=1, append=circuit[:, -1:])
        by_both = np.diff(by_soc, axis=1, append=by_soc[:, -1:])
        stack = np.stack((circuit, by_soc, by_temperature, by_both))
        self.circuit = np.ascontiguousarray(stack.reshape(4, circuit.shape[0], -1))
        self.tau_s = np.ascontiguousarray(values[2 + model.n_rc :])
        fixed = all(np.ptp(tau) == 0.0 for tau in model.tau_s)
        self.tau_fixed_s = model.tau_s[:, 0, 0].copy() if fixed else None

    def place(self, temperature_degc: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the table row (n,) and the weight (n,) of the next one, for each temperature [degC]."""
        grid = self.temperature_grid_degc
        if self.n_t == 1:
            return np.zeros(temperature_degc.shape, dtype=np.intp), np.zeros(temperature_degc.shape)
        j = np.clip(np.searchsorted(grid, temperature_degc, side="right") - 1, 0, self.n_t - 2)
        return j, np.clip((temperature_degc - grid[j]) / (grid[j + 1] - grid[j]), 0.0, 1.0)

    def place_soc(self, soc: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the grid index and the weight of the next point, for each SOC; held at the ends of the tables."""
        x = (soc - SOC_LOW) * (1.0 / SOC_STEP)
        x = np.minimum(np.maximum(x, 0.0), N_SOC - 1.0)
        j = x.astype(np.intp)
        return j, x - j

    def ocv_at(self, j: IntArray, f: FloatArray) -> FloatArray:
        """Return the OCV [V] at grid places."""
        pair = self.ocv.take(j, axis=1)
        return np.asarray(pair[0] + f * pair[1])

    def ocv_of(self, soc: FloatArray) -> FloatArray:
        """Return the OCV [V] at each SOC, without a place."""
        return np.asarray(np.interp(soc, self._soc, self.ocv[0]))

    def ocv_slope_at(self, j: IntArray, f: FloatArray) -> FloatArray:
        """Return dOCV/dSOC [V] at grid places."""
        pair = self.ocv_slope.take(j, axis=1)
        return np.asarray(pair[0] + f * pair[1])

    def circuit_at(self, j: IntArray, f: FloatArray, row: IntArray, g: FloatArray) -> FloatArray:
        """Return (1 + n_rc, n) R0, R_k (and e) at grid places j + f in SOC and row + g in temperature."""
        if self.n_t == 1:
            pair = self.circuit[:2].take(j, axis=2)
            return np.asarray(pair[0] + f * pair[1])
        corner = self.circuit.take(j + N_SOC * row, axis=2)
        in_soc = corner[0::2] + f * corner[1::2]
        return np.asarray(in_soc[0] + g * in_soc[1])

    def circuit_slope_at(self, j: IntArray, row: IntArray, g: FloatArray) -> FloatArray:
        """Return (1 + n_rc, n) derivative of R0, R_k (and e) with SOC at grid places."""
        corner = self.circuit[1::2].take(j + N_SOC * row, axis=2)
        return np.asarray((corner[0] + g * corner[1]) * (1.0 / SOC_STEP))

    def drop(self, c: FloatArray, current_a: float, branch_a: FloatArray) -> FloatArray:
        """Return (n,) R0 i + e asinh(i / i_ref) + sum R_k i_k [V] for parameters of `circuit_at`, or its slope."""
        drop = current_a * c[R0]
        for k in range(branch_a.shape[0]):
            drop += c[BRANCH + k] * branch_a[k]
        if self.has_overpotential:
            drop += math.asinh(current_a / self.model.overpotential_current_a) * c[-1]
        return np.asarray(drop)

    def tau_at(self, j: IntArray, f: FloatArray, row: IntArray, g: FloatArray) -> FloatArray:
        """Return (n_rc, n) time constants [s] at grid places."""
        k, up = np.minimum(j + 1, N_SOC - 1), np.minimum(row + 1, self.n_t - 1)
        low = self.tau_s[:, row, j] * (1 - f) + self.tau_s[:, row, k] * f
        high = self.tau_s[:, up, j] * (1 - f) + self.tau_s[:, up, k] * f
        return np.asarray(low * (1 - g) + high * g)


def _with_difference(values: FloatArray) -> FloatArray:
    return np.stack((values, np.diff(values, append=values[-1:])))
