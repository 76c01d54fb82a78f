"""What voltage a state predicts, and how it depends on the state: over sigma points, or along the tangent.

Columns of the table are OCV, -R0, -e (where the cell has an overpotential) and -R_k, their factors 1, i,
asinh(i / i_ref) and i_k: the output is the sum of the products. The three sigma points are looked up at once.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.inputs import Climate, StepInput
from app.estimation.sigma_points import SigmaRule
from app.estimation.states import SOC, CellStates
from app.estimation.tables import BRANCH, N_SOC, R0, SOC_LOW, SOC_STEP, PackedCell

FloatArray = NDArray[np.float64]

# A scalar costs a ufunc more than an array without dimensions does.
ZERO: Final = np.array(0.0)
HALF: Final = np.array(0.5)
TOP: Final = np.array(N_SOC - 1.0)
LOW: Final = np.array(SOC_LOW)
PER_STEP: Final = np.array(1.0 / SOC_STEP)


class SigmaOutput:
    """Mean output and statistical slopes over the three sigma points that see another SOC.

    Attributes:
        slopes: (d, n) H = [D + p r / P_zz, -r] of the last call.
        ocv_slope_v: (n,) the OCV's share of D [V].
    """

    def __init__(self, cell: PackedCell, states: CellStates, rule: SigmaRule) -> None:
        n, m = states.n_cells, states.n_rc
        self._table, c = _stacked(cell)
        self._has_rows = cell.n_t > 1
        self._over_a = cell.model.overpotential_current_a if cell.has_overpotential else None
        self._constants = np.array(rule.spread), np.array(rule.weight), np.array(rule.curvature)
        self._climate: Climate | None = None
        self._place_weight = np.empty((2 * c - 1, 3 * n))
        points, work = np.empty((3, n)), np.empty((4, n))
        self._look_up_views = points, *points, points.reshape(-1), *np.empty((2, 3 * n)), np.empty(3 * n, np.intp)
        found, product = np.empty((self._table.shape[0], 3 * n)), np.empty((c, 3 * n))
        blend = np.empty((2 * c - 1, 3 * n))
        self._found = found
        self._blend_views = found[2 * c :], blend, found[1 : 2 * c]
        self._value_views = found[:c], found[c : 2 * c], product
        self._states = states
        self._resistances = found[1:c].reshape(c - 1, 3, n)
        self._product_rows = list(product)
        self._ocv_right, self._ocv_left = product[0].reshape(3, n)[1:]
        self.ocv_slope_v = np.empty(n)
        self._sigma_views = (states.mean[SOC], states.cov[SOC, SOC], *work)
        h = np.empty((3, n))
        self._h_views = (h.reshape(-1), *h)
        self._factors = np.ones((c, 3 * n))
        self._current_row = self._factors[1 + R0]
        # -R_k at the centre are slopes where they stand; the column before them has been used when D takes its place
        self.slopes = found[c - m - 1 : c, :n]
        shift = np.empty((m, n))
        self._branches = [
            (
                states.mean[k + 1],
                states.cov[SOC, k + 1],
                shift[k],
                self.slopes[k + 1],
                *self._factors[c - m + k].reshape(3, n),
            )
            for k in range(m)
        ]
        self._curvature_views: tuple[FloatArray, ...] = (self.slopes[SOC], *np.empty((2, n)))

    def at(self, step: StepInput, mean: FloatArray) -> FloatArray:
        """Put the mean output [V] into a row (n,) and return k q^2 (n,) [V^2], good until the next call."""
        spread, weight, curvature = self._constants
        soc, variance, sd, reach, per_sd, term = self._sigma_views
        np.sqrt(variance, sd)
        np.multiply(sd, spread, reach)
        np.divide(spread, sd, per_sd)
        self._look_up(step, soc, reach)
        self._current_row.fill(step.current_a)
        if self._over_a is not None:
            self._factors[2] = math.asinh(step.current_a / self._over_a)
        for current, covariance, shift, _, centre, right, left in self._branches:
            np.multiply(covariance, per_sd, shift)
            np.copyto(centre, current)
            np.add(current, shift, right)
            np.subtract(current, shift, left)
        values, _, product = self._value_views
        np.multiply(values, self._factors, product)
        h, h0, up, down = self._h_views
        first, second, *others = self._product_rows
        np.add(first, second, h)
        for row in others:
            np.add(h, row, h)
        # D + p r / P_zz with p = shift P_zz / (c s); the columns hold -r
        steep, q, q2 = self._curvature_views
        np.subtract(up, down, steep)
        np.multiply(steep, HALF, steep)
        for _, _, shift, slope, *_ in self._branches:
            np.multiply(shift, slope, term)
            np.subtract(steep, term, steep)
        np.divide(steep, reach, steep)
        slope = self.ocv_slope_v
        np.subtract(self._ocv_right, self._ocv_left, slope)
        np.multiply(slope, HALF, slope)
        np.divide(slope, reach, slope)
        np.add(up, down, q)
        np.add(h0, h0, term)
        np.subtract(q, term, q)
        np.multiply(q, weight, mean)
        np.add(mean, h0, mean)
        np.multiply(q, q, q2)
        np.multiply(q2, curvature, q2)
        return q2

    def _look_up(self, step: StepInput, centre: FloatArray, reach: FloatArray) -> None:
        """Fill the first columns of `found` with the table's values at the centre and `reach` right and left of it."""
        _, soc, right, left, points, floor, fraction, index = self._look_up_views
        np.subtract(centre, LOW, soc)
        np.add(soc, reach, right)
        np.subtract(soc, reach, left)
        np.multiply(points, PER_STEP, points)
        if points.item(points.argmin()) < 0.0 or points.item(points.argmax()) > N_SOC - 1.0:
            np.maximum(points, ZERO, out=points)
            np.minimum(points, TOP, out=points)
        np.floor(points, floor)
        np.subtract(points, floor, fraction)
        np.copyto(index, floor, casting="unsafe")
        if self._has_rows:
            climate = step.climate
            if climate is not self._climate:
                self._climate = climate
                self._place_weight[:] = np.tile(climate.row_weight, 3)
            np.add(index, climate.offset3, index)
            self._table.take(index, 1, self._found, "clip")
            by_temperature, blend, blended = self._blend_views
            np.multiply(by_temperature, self._place_weight, blend)
            np.add(blended, blend, blended)
        else:
            self._table.take(index, 1, self._found, "clip")
        values, by_soc, product = self._value_views
        np.multiply(by_soc, fraction, product)
        np.add(values, product, values)
        if self._states.has_resistance:
            np.multiply(self._resistances, self._states.resistance, self._resistances)


class TangentOutput:
    """Output and its derivative at the mean: what makes an extended Kalman filter of the same algebra.

    Attributes:
        slopes: (d, n) H of the last call.
        ocv_slope_v: (n,) the OCV's share of H [V].
    """

    def __init__(self, cell: PackedCell, states: CellStates) -> None:
        self._cell = cell
        self._states = states
        self.slopes = np.empty_like(states.mean)
        self.ocv_slope_v = np.empty(states.n_cells)

    def at(self, step: StepInput, output: FloatArray) -> FloatArray:
        """Put the output [V] into a row (n,) and return the zeros that stand for curvature."""
        cell, x = self._cell, self._states.mean
        row, weight = step.climate.row, step.climate.row_weight
        j, f = cell.place_soc(x[SOC])
        c = cell.circuit_at(j, f, row, weight)
        slope = cell.circuit_slope_at(j, row, weight)
        self.ocv_slope_v[:] = cell.ocv_slope_at(j, f)
        resistance = self._states.resistance
        self.slopes[SOC] = self.ocv_slope_v - resistance * cell.drop(slope, step.current_a, x[1:])
        np.multiply(c[BRANCH : BRANCH + self._states.n_rc], -resistance, self.slopes[1:])
        np.subtract(cell.ocv_at(j, f), resistance * cell.drop(c, step.current_a, x[1:]), output)
        return np.zeros(self._states.n_cells)


def _stacked(cell: PackedCell) -> tuple[FloatArray, int]:
    """Return the table and its number of columns c.

    Rows are c values, c differences to the next SOC, and where the cell knows several temperatures the differences
    of rows 1 to 2 c - 1 to the next temperature; (.., n_t * N_SOC).
    """
    m = cell.model.n_rc
    order = [R0, *([BRANCH + m] if cell.has_overpotential else []), *range(BRANCH, BRANCH + m)]
    ocv = np.tile(cell.ocv, (1, cell.n_t))
    value, by_soc, by_temperature, by_both = -cell.circuit[:, order]
    rows = [ocv[:1], value, ocv[1:], by_soc]
    if cell.n_t > 1:
        rows += [by_temperature, np.zeros_like(ocv[:1]), by_both]
    return np.ascontiguousarray(np.concatenate(rows)), 1 + len(order)
