"""A cell model laid out for look-ups of many cells at once: even in SOC, one row of coefficients for each point.

Values between grid points are linear in SOC and temperature; beyond the tables their last values hold. Both engines and
the textbook filters of the tests read the cell through these tables, so that they differ in nothing but their algebra.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray, IntArray
from app.estimation.cell_model.circuit import EMPTY_ACTIVATION_J_MOL, CellModel
from app.estimation.cell_model.surface import GAS_CONSTANT, KELVIN

SOC_LOW: Final = -0.1  # the tables reach past 0 and 1, because sigma points do
SOC_HIGH: Final = 1.1
SOC_STEP: Final = 0.001
SOC_INVERSE: Final = (-0.05, 1.05)  # range of a SOC that is read off a voltage
READING_V: Final = 0.02  # error of a model's voltage by which the SOC is misread
OCV, R0, OVERPOTENTIAL, PER_REFERENCE, R1 = range(5)  # columns of the table; the other R_k follow
REFERENCE_DEGC: Final = 25.0
LASTING_OHM: Final = 1.0  # the state of the lasting error is a current through this much
LASTING_S: Final = 600.0  # its correlation time
SEEN_FACTOR: Final = 1.1  # times the largest current of the fit: a current that is larger was not seen
CURRENT_MAX_C: Final = 60.0  # a larger reading is a broken sensor, not a current
DROP_ERROR, OCV_ERROR, LASTING_DROP, COLD, LOWEST = range(5)  # columns of the uncertainty
UNCERTAINTY_DEGC: Final = (-60.0, 120.0, 2.5)  # temperatures of the uncertainty: first, last, step

Place = tuple[IntArray, FloatArray]  # grid index and weight of the next point, for each cell


class CellTables:
    """Tables of one cell model.

    Attributes:
        model: the cell model.
        soc: (n_soc,) SOC of the points.
        temperature_degc: (n_t,) temperature of the tables [degC], rising.
        n_rc: branches: the RC pairs of the model, and last the lasting error, which no current drives.
        slow_pair: which RC pair is the slowest, -1 without any.
        table: (n_t, n_soc, 4 + n_rc) OCV [V], R0 [ohm], e [V], 1 / i_ref [1/A] and R_k [ohm].
        surface: (n_t, n_rc - 1) d_k at the temperatures [1/A], zeros where the model has no surface.
        uncertainty: (n, 5) what is not known at temperatures even apart: share by which resistances may be off, how
            far the OCV may be off [V], voltage a lasting current takes for each ampere [ohm], how much earlier than
            at 25 degC the cell looks empty, and the lowest SOC that was seen under load.
        seen_a: largest current that the model was made of; where the file does not say, the largest of any cell [A].
        ocv_slope_v: (n_soc,) dOCV/dSOC; with a smoothed OCV this is the smoothed slope [V].
        reading_slope_v: (n_soc,) volts per SOC at which a voltage READING_V off reads the SOC, the less of both sides.
        tau_s: (n_rc,) where every time constant is the same at any SOC and temperature, else (n_t, n_soc, n_rc) [s].
    """

    def __init__(self, model: CellModel, soc_step: float = SOC_STEP) -> None:
        n = round((SOC_HIGH - SOC_LOW) / soc_step) + 1
        self.model = model
        self.n_rc = model.n_rc + 1
        self.slow_pair = int(np.argmax(model.tau_s.mean(axis=(1, 2)))) if model.n_rc else -1
        self.soc_low = SOC_LOW
        self.soc_step = soc_step
        self.soc = SOC_LOW + soc_step * np.arange(n)
        self.temperature_degc = model.temperature_grid_degc
        r0, over, *rc = model.parameters(self.soc, self.temperature_degc[:, None])
        per_reference = model.per_reference(self.soc, self.temperature_degc[:, None])
        # what temperature does to the OCV may not make it fall anywhere: its inverse has to exist
        ocv = np.maximum.accumulate(model.open_circuit_voltage(self.soc, self.temperature_degc[:, None]), axis=1)
        lasting_ohm, lasting_s = np.full_like(r0, LASTING_OHM), np.full_like(r0, LASTING_S)
        self.table = np.ascontiguousarray(
            np.stack([ocv, r0, over, per_reference, *rc[: model.n_rc], lasting_ohm], axis=-1)
        )
        self.has_surface = model.has_surface
        surface = (
            np.zeros((model.n_rc, self.temperature_degc.size)) if model.surface_per_a is None else model.surface_per_a
        )
        self.surface = np.ascontiguousarray(surface.T)
        self.ocv_slope_v = model.ocv.slope(self.soc)
        self.reading_slope_v = reading_slope(model, np.asarray(self.soc, dtype=np.float64))
        self.has_overpotential = self.has_surface or bool(over.any())
        self.has_tau_table = any(np.ptp(tau) > 0.0 for tau in model.tau_s)
        taus = np.stack([*rc[model.n_rc :], lasting_s], axis=-1)
        self.tau_s = np.ascontiguousarray(taus if self.has_tau_table else taus[0, 0])
        self.uncertainty = _uncertainty(model)
        self.seen_a = SEEN_FACTOR * model.fit_current_max_a or CURRENT_MAX_C * model.capacity_ah

    def packed(self, width: int | None = None) -> FloatArray:
        """Return (n_t, n_soc, width) the columns that the C engine looks up: OCV, R0, R_k, e and 1 / i_ref.

        e where there is one, and 1 / i_ref where it is not the same everywhere.

        The lasting error's resistance is always the same.

        Args:
            width: numbers from one point to the next, zeros in those that are not used; None = just what is used.
        """
        columns = [OCV, R0, *range(R1, R1 + self.n_rc - 1)]
        columns += [OVERPOTENTIAL] * self.has_overpotential + [PER_REFERENCE] * self.has_surface
        packed = np.zeros((*self.table.shape[:2], width or len(columns)))
        packed[..., : len(columns)] = self.table[..., columns]
        return packed

    def place_temperature(self, temperature_degc: FloatArray) -> Place:
        """Return the table row (n,) and the weight (n,) of the next one, for each temperature [degC]."""
        return _place(np.interp(temperature_degc, self.temperature_degc, np.arange(self.temperature_degc.size)))

    def uncertainty_at(self, temperature_degc: FloatArray) -> FloatArray:
        """Return (5, n) the uncertainty at each temperature [degC]."""
        low, _, step = UNCERTAINTY_DEGC
        x = np.clip((temperature_degc - low) / step, 0.0, self.uncertainty.shape[0] - 1.0)
        j = np.minimum(x.astype(np.intp), self.uncertainty.shape[0] - 2)
        w = (x - j)[:, None]
        return np.asarray((self.uncertainty[j] + w * (self.uncertainty[j + 1] - self.uncertainty[j])).T)

    def place_soc(self, soc: FloatArray) -> Place:
        """Return the grid index and the weight of the next point, for each SOC."""
        return _place(np.clip((soc - self.soc_low) / self.soc_step, 0.0, self.soc.size - 1.0))

    def circuit(self, soc: FloatArray, at: Place) -> FloatArray:
        """Return (4 + n_rc, n) OCV, R0, e, 1 / i_ref and R_k of each cell, at its SOC and temperature's place."""
        return _interpolate(self.table, at, self.place_soc(soc))

    def circuit_slope(self, soc: FloatArray, at: Place) -> FloatArray:
        """Return (4 + n_rc, n) derivatives of the same with SOC; that of the OCV may be smoothed."""
        j, _ = self.place_soc(soc)
        j = np.minimum(j, self.soc.size - 2)
        (row, g), up = at, np.minimum(at[0] + 1, self.temperature_degc.size - 1)
        cool = self.table[row, j + 1] - self.table[row, j]
        warm = self.table[up, j + 1] - self.table[up, j]
        slope = ((1.0 - g)[:, None] * cool + g[:, None] * warm).T / self.soc_step
        slope[OCV] = self.ocv_slope(soc)
        return np.asarray(slope)

    def surface_at(self, at: Place) -> FloatArray:
        """Return (n_rc, n) d_k at the place of each temperature [1/A]; 0 of the lasting error."""
        (row, g), up = at, np.minimum(at[0] + 1, self.temperature_degc.size - 1)
        d = self.surface[row] + g[:, None] * (self.surface[up] - self.surface[row])
        return np.vstack((d.T, np.zeros(row.size)))

    def time_constants(self, soc: FloatArray, at: Place) -> FloatArray:
        """Return (n_rc, n) time constants of each cell [s]."""
        if self.has_tau_table:
            return _interpolate(self.tau_s, at, self.place_soc(soc))
        return np.repeat(self.tau_s[:, None], soc.size, axis=1)

    def ocv(self, soc: FloatArray, at: Place | None = None) -> FloatArray:
        """Return the OCV [V] of each cell, at its SOC and the place of its temperature; None = 25 degC."""
        at = self.place_temperature(np.full(soc.shape, REFERENCE_DEGC)) if at is None else at
        return np.asarray(_interpolate(self.table[:, :, OCV : OCV + 1], at, self.place_soc(soc))[0])

    def ocv_slope(self, soc: FloatArray) -> FloatArray:
        """Return dOCV/dSOC [V] at each SOC."""
        return np.asarray(np.interp(soc, self.soc, self.ocv_slope_v))

    def reading_slope(self, soc: FloatArray) -> FloatArray:
        """Return volts per SOC at which a voltage reads each SOC [V]."""
        return np.asarray(np.interp(soc, self.soc, self.reading_slope_v))

    def reading_sigma(self, soc: FloatArray, sigma_v: FloatArray, at: Place | None = None) -> FloatArray:
        """Return (n,) how far the SOC may lie from `soc` where the voltage there has a sigma; the farther side.

        At the foot of a step of the OCV the near side says little.
        """
        ocv = self.ocv(soc, at)
        above, below = self.soc_of_ocv(ocv + sigma_v, at) - soc, soc - self.soc_of_ocv(ocv - sigma_v, at)
        return np.maximum(np.maximum(above, below), 1e-3)

    def soc_of_ocv(self, voltage_v: FloatArray, at: Place | None = None) -> FloatArray:
        """Return the SOC, -0.05 .. 1.05, whose OCV at a temperature is the given voltage [V]; NaN for NaN."""
        row, g = self.place_temperature(np.full(voltage_v.shape, REFERENCE_DEGC)) if at is None else at
        above = np.minimum(row + 1, self.temperature_degc.size - 1)
        cool, warm = self.table[row, :, OCV], self.table[above, :, OCV]
        soc = np.full(voltage_v.shape, np.nan)
        for k, ocv in enumerate((1.0 - g)[:, None] * cool + g[:, None] * warm):
            below = int(np.clip(np.searchsorted(ocv, voltage_v[k], side="right") - 1, 0, ocv.size - 2))
            low, high = ocv[below], ocv[below + 1]
            soc[k] = self.soc_low + self.soc_step * (
                below + ((voltage_v[k] - low) / (high - low) if high > low else 0.0)
            )
        return np.asarray(np.clip(soc, *SOC_INVERSE))


def _uncertainty(model: CellModel) -> FloatArray:
    low, high, step = UNCERTAINTY_DEGC
    degc = np.arange(low, high + 0.5 * step, step)
    colder = np.maximum(1.0 / (degc + KELVIN) - 1.0 / (REFERENCE_DEGC + KELVIN), 0.0)
    columns = [model.drop_error(degc), model.ocv_error_v(degc), model.lasting_ohm(degc)]
    columns += [np.exp(EMPTY_ACTIVATION_J_MOL / GAS_CONSTANT * colder), model.lowest_soc(degc)]
    return np.ascontiguousarray(np.stack(columns, axis=-1))


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
