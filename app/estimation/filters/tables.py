"""A cell model laid out for look-ups of many cells at once: even in SOC, one row of coefficients for each point.

Values between grid points are linear in SOC and temperature; beyond the tables their last values hold. Both engines and
the textbook filters of the tests read the cell through these tables, so that they differ in nothing but their algebra.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray, IntArray
from app.estimation.cell_model.circuit import CellModel

SOC_LOW: Final = -0.1  # the tables reach past 0 and 1, because sigma points do
SOC_HIGH: Final = 1.1
SOC_STEP: Final = 0.001
SOC_INVERSE: Final = (-0.05, 1.05)  # range of a SOC that is read off a voltage
READING_V: Final = 0.02  # error of a model's voltage by which the SOC is misread
OCV, R0, OVERPOTENTIAL, R1 = range(4)  # columns of the table; the other RC resistances follow

Place = tuple[IntArray, FloatArray]  # grid index and weight of the next point, for each cell


class CellTables:
    """Tables of one cell model.

    Attributes:
        model: the cell model.
        soc: (n_soc,) SOC of the points.
        temperature_degc: (n_t,) temperature of the tables [degC], rising.
        table: (n_t, n_soc, 3 + n_rc) OCV [V], R0 [ohm], e [V] and R_k [ohm].
        ocv_slope_v: (n_soc,) dOCV/dSOC; with a smoothed OCV this is the smoothed slope [V].
        reading_slope_v: (n_soc,) volts per SOC at which a voltage READING_V off reads the SOC, the less of both sides.
        tau_s: (n_rc,) where every time constant is the same at any SOC and temperature, else (n_t, n_soc, n_rc) [s].
    """

    def __init__(self, model: CellModel, soc_step: float = SOC_STEP) -> None:
        n = round((SOC_HIGH - SOC_LOW) / soc_step) + 1
        self.model = model
        self.n_rc = model.n_rc
        self.soc_low = SOC_LOW
        self.soc_step = soc_step
        self.soc = SOC_LOW + soc_step * np.arange(n)
        self.temperature_degc = model.temperature_grid_degc
        r0, over, *rc = model.parameters(self.soc, self.temperature_degc[:, None])
        ocv = np.broadcast_to(model.ocv.voltage(self.soc), r0.shape)
        self.table = np.ascontiguousarray(np.stack([ocv, r0, over, *rc[: self.n_rc]], axis=-1))
        self.ocv_slope_v = model.ocv.slope(self.soc)
        self.reading_slope_v = reading_slope(model, np.asarray(self.soc, dtype=np.float64))
        self.has_overpotential = bool(over.any())
        self.has_tau_table = any(np.ptp(tau) > 0.0 for tau in model.tau_s)
        taus = np.moveaxis(np.array(rc[self.n_rc :]).reshape(self.n_rc, *r0.shape), 0, -1)
        self.tau_s = np.ascontiguousarray(taus if self.has_tau_table else model.tau_s[:, 0, 0])

    def place_temperature(self, temperature_degc: FloatArray) -> Place:
        """Return the table row (n,) and the weight (n,) of the next one, for each temperature [degC]."""
        return _place(np.interp(temperature_degc, self.temperature_degc, np.arange(self.temperature_degc.size)))

    def place_soc(self, soc: FloatArray) -> Place:
        """Return the grid index and the weight of the next point, for each SOC."""
        return _place(np.clip((soc - self.soc_low) / self.soc_step, 0.0, self.soc.size - 1.0))

    def circuit(self, soc: FloatArray, at: Place) -> FloatArray:
        """Return (3 + n_rc, n) OCV, R0, e and R_k of each cell, at its SOC and the place of its temperature."""
        return _interpolate(self.table, at, self.place_soc(soc))

    def circuit_slope(self, soc: FloatArray, at: Place) -> FloatArray:
        """Return (3 + n_rc, n) derivatives of the same with SOC; that of the OCV may be smoothed."""
        j, _ = self.place_soc(soc)
        j = np.minimum(j, self.soc.size - 2)
        (row, g), up = at, np.minimum(at[0] + 1, self.temperature_degc.size - 1)
        cool = self.table[row, j + 1] - self.table[row, j]
        warm = self.table[up, j + 1] - self.table[up, j]
        slope = ((1.0 - g)[:, None] * cool + g[:, None] * warm).T / self.soc_step
        slope[OCV] = self.ocv_slope(soc)
        return np.asarray(slope)

    def time_constants(self, soc: FloatArray, at: Place) -> FloatArray:
        """Return (n_rc, n) time constants of each cell [s]."""
        if self.has_tau_table:
            return _interpolate(self.tau_s, at, self.place_soc(soc))
        return np.repeat(self.tau_s[:, None], soc.size, axis=1)

    def ocv(self, soc: FloatArray) -> FloatArray:
        """Return the OCV [V] at each SOC."""
        return np.asarray(np.interp(soc, self.soc, self.table[0, :, OCV]))

    def ocv_slope(self, soc: FloatArray) -> FloatArray:
        """Return dOCV/dSOC [V] at each SOC."""
        return np.asarray(np.interp(soc, self.soc, self.ocv_slope_v))

    def reading_slope(self, soc: FloatArray) -> FloatArray:
        """Return volts per SOC at which a voltage reads each SOC [V]."""
        return np.asarray(np.interp(soc, self.soc, self.reading_slope_v))

    def reading_sigma(self, soc: FloatArray, sigma_v: FloatArray) -> FloatArray:
        """Return (n,) how far the SOC may lie from `soc` where the voltage there has a sigma; the farther side.

        At the foot of a step of the OCV the near side says little.
        """
        ocv = self.ocv(soc)
        above, below = self.soc_of_ocv(ocv + sigma_v) - soc, soc - self.soc_of_ocv(ocv - sigma_v)
        return np.maximum(np.maximum(above, below), 1e-3)

    def soc_of_ocv(self, voltage_v: FloatArray) -> FloatArray:
        """Return the SOC, -0.05 .. 1.05, whose OCV is the given voltage [V]; NaN for NaN."""
        ocv = self.table[0, :, OCV]
        below = np.clip(np.searchsorted(ocv, voltage_v, side="right") - 1, 0, ocv.size - 2)
        low, high = ocv[below], ocv[below + 1]
        weight = np.where(high > low, (voltage_v - low) / np.where(high > low, high - low, 1.0), 0.0)
        return np.clip(self.soc_low + self.soc_step * (below + weight), *SOC_INVERSE)


def _place(x: FloatArray) -> Place:
    j = x.astype(np.intp)
    return j, x - j


def _interpolate(table: FloatArray, at: Place, soc: Place) -> FloatArray:
    """Return (columns, n): linear in SOC at both temperatures, then linear between them."""
    (row, g), (j, f) = at, soc
    up, right = np.minimum(row + 1, table.shape[0] - 1), np.minimum(j + 1, table.shape[1] - 1)
    f, g = f[:, None], g[:, None]
    cool = (1.0 - f) * table[row, j] + f * table[row, right]
    warm = (1.0 - f) * table[up, j] + f * table[up, right]
    return np.asarray(((1.0 - g) * cool + g * warm).T)


def reading_slope(model: CellModel, soc: FloatArray) -> FloatArray:
    """Return (n,) volts per SOC at which a voltage that is READING_V off reads the SOC, the less of both sides."""
    grid = np.linspace(*SOC_INVERSE, 4401)
    ocv = np.maximum.accumulate(model.ocv.voltage(grid)) + 1e-9 * np.arange(grid.size)
    inside = np.clip(soc, *SOC_INVERSE)
    here = np.interp(inside, grid, ocv)
    above = np.interp(here + READING_V, ocv, grid) - inside
    below = inside - np.interp(here - READING_V, ocv, grid)
    return np.asarray(READING_V / np.maximum(np.maximum(above, below), 1e-3))
