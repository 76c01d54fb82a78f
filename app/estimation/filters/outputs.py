"""What voltage a state predicts, and how it depends on the state: over sigma points, or along the tangent.

Columns of the table are OCV, -R0, -R_k and -e (where the cell has an overpotential), their factors 1, i, i_k and
asinh(i / i_ref): the output is the sum of the products. The three sigma points are looked up at once.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.filters.inputs import Climate, StepInput
from app.estimation.filters.sigma_points import SigmaRule
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import BRANCH, N_SOC, R0, SOC_LOW, SOC_STEP, PackedCell

SOC_HIGH: Final = SOC_LOW + (N_SOC - 1) * SOC_STEP
# what q, and the slopes of OCV and output times c s, take of the outputs at centre, right and left, then of the OCV
# there; right and left count from the centre, and the factors are such that rounding cannot touch them
MIXTURE: Final = np.array(
    [[0.0, 1.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.5, -0.5], [0.0, 0.5, -0.5, 0.0, 0.0, 0.0]]
)
# a scalar costs a ufunc more than an array without dimensions does
PER_STEP: Final = np.array(1.0 / SOC_STEP)
ORIGIN: Final = np.array(-SOC_LOW / SOC_STEP)


class SigmaOutput:
    """Mean output and statistical slopes over the three sigma points that see another SOC.

    Attributes, good until the next call of `at`:
        ocv_slope_v: (n,) the OCV's share of D [V].
        slopes: (d, n) H = [D + p r / P_zz, -r].
    """

    def __init__(self, cell: PackedCell, states: CellStates, rule: SigmaRule) -> None:
        n, m = states.n_cells, states.n_rc
        d = 1 + m
        self._table, c = _stacked(cell)
        self._has_rows = cell.n_t > 1
        self._over_a = cell.model.overpotential_current_a if cell.has_overpotential else None
        self._climate: Climate | None = None
        self._place_weight = np.empty((2 * c - 1, 3 * n))
        self._states = states
        self._spread, *self._weights = np.array(rule.spread), np.array(rule.weight), np.array(rule.curvature)
        points = np.empty((3, d, n))
        self._state_views = states.mean, states.cov[SOC, SOC], states.cov[SOC]
        self._point_views = (*np.empty((2, n)), *np.empty((2, d, n)), *points)
        self._factors = np.ones((c - 1, 3, n))
        self._factor_views = self._factors[:d], points.transpose(1, 0, 2), self._factors[SOC]
        self._place_views = self._factors[SOC].reshape(-1), *np.empty((3, 3 * n)), np.empty(3 * n, np.intp)
        mixed = np.empty((3 + 3 * self._table.shape[0], n))  # outputs at the points, then what was found there
        self._found = mixed[3:].reshape(-1, 3 * n)
        self._blend_views = self._found[1 : 2 * c], self._found[2 * c :], np.empty((2 * c - 1, 3 * n))
        values, centres = self._found[:c], np.zeros((c, 3, n))
        self._value_views = values, self._found[c : 2 * c], *np.empty((2, c, 3 * n))
        self._centre_views = centres[:, 1:], values[:, None, :n], centres, values.reshape(c, 3, n)
        products, sums = values[1:].reshape(-1, 3, n), mixed[:3]
        self._resistance_views = products, states.resistance, np.empty_like(products)
        self._sum_views = products, values[0].reshape(3, n), *products[:1], sums, list(products[1:]), sums[0]
        seen = np.empty((2 + d, n))
        self._bend, self.ocv_slope_v, self.slopes = seen[0], seen[1], seen[2:]
        self._slope_views = self.slopes[1:], values[2 : 2 + m, :n]
        self._mix_views = mixed[:6], seen[:3], seen[1:3], np.empty((2, n))

    def at(self, step: StepInput, output: FloatArray, bend_v2: FloatArray) -> None:
        """Compute the attributes for the state as it is and a sample's current and temperatures.

        Args:
            step: the sample.
            output: (n,) where the mean output goes [V].
            bend_v2: (n,) where k q^2 goes, the variance that curvature adds [V^2].
        """
        mean, variance, with_soc = self._state_views
        sd, per_sd, per_sds, column, centre, right, left = self._point_views
        # the first column of the Cholesky factor, c times: P_z. c / s
        np.sqrt(variance, sd)
        np.divide(self._spread, sd, per_sd)
        per_sds[...] = per_sd
        np.multiply(with_soc, per_sds, column)
        centre[...] = mean
        np.add(mean, column, right)
        np.subtract(mean, column, left)
        factors, points, currents = self._factor_views
        factors[...] = points
        self._look_up(step)
        currents.fill(step.current_a)
        if self._over_a is not None:
            self._factors[-1].fill(math.asinh(step.current_a / self._over_a))
        slopes, minus_r = self._slope_views
        slopes[...] = minus_r
        # right and left beyond the centre, so that small differences keep their digits
        beside, centre_values, centres, values = self._centre_views
        beside[...] = centre_values
        np.subtract(values, centres, values)
        products, ocv, first, sums, others, own = self._sum_views
        np.multiply(products, self._factors, products)
        np.add(ocv, first, sums)
        for row in others:
            np.add(sums, row, sums)
        mixed, seen, over_reach, reach = self._mix_views
        MIXTURE.dot(mixed, seen)
        reach[...] = column[SOC]
        np.divide(over_reach, reach, over_reach)
        # h0 + w q,  k q^2
        bend, (weight, curvature) = self._bend, self._weights
        np.multiply(bend, weight, output)
        np.add(output, own, output)
        np.multiply(bend, bend, bend_v2)
        np.multiply(bend_v2, curvature, bend_v2)

    def _look_up(self, step: StepInput) -> None:
        """Fill the first columns of `found` with the table's values at the SOC of the points, the first factor."""
        soc, place, floor, fraction, index = self._place_views
        if soc.item(soc.argmin()) < SOC_LOW or soc.item(soc.argmax()) > SOC_HIGH:
            np.maximum(soc, SOC_LOW, out=soc)
            np.minimum(soc, SOC_HIGH, out=soc)
        np.multiply(soc, PER_STEP, place)
        np.add(place, ORIGIN, place)
        np.floor(place, floor)
        np.subtract(place, floor, fraction)
        climate = step.climate
        if self._has_rows:
            np.add(floor, climate.offset3, floor)
        index[...] = floor
        self._table.take(index, 1, self._found, "clip")
        if self._has_rows:
            if climate is not self._climate:
                self._climate = climate
                self._place_weight[:] = np.tile(climate.row_weight, 3)
            blended, by_temperature, blend = self._blend_views
            np.multiply(by_temperature, self._place_weight, blend)
            np.add(blended, blend, blended)
        values, by_soc, fractions, product = self._value_views
        fractions[...] = fraction
        np.multiply(by_soc, fractions, product)
        np.add(values, product, values)
        if self._states.has_resistance:
            minus_resistances, own, owns = self._resistance_views
            owns[...] = own
            np.multiply(minus_resistances, owns, minus_resistances)


class TangentOutput:
    """Output and its derivative at the mean: what makes an extended Kalman filter of the same algebra.

    Attributes, good until the next call of `at`:
        ocv_slope_v: (n,) the OCV's share of H [V].
        slopes: (d, n) H.
    """

    def __init__(self, cell: PackedCell, states: CellStates) -> None:
        self._cell = cell
        self._states = states
        self.slopes = np.empty_like(states.mean)
        self.ocv_slope_v = np.empty(states.n_cells)

    def at(self, step: StepInput, output: FloatArray, bend_v2: FloatArray) -> None:
        """Compute the attributes; see `SigmaOutput.at`. A tangent does not bend."""
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
        bend_v2.fill(0.0)


def _stacked(cell: PackedCell) -> tuple[FloatArray, int]:
    """Return the table and its number of columns c.

    Rows are c values, c differences to the next SOC, and where the cell knows several temperatures the differences
    of rows 1 to 2 c - 1 to the next temperature; (.., n_t * N_SOC).
    """
    order = [R0, *range(BRANCH, BRANCH + cell.model.n_rc)] + (
        [BRANCH + cell.model.n_rc] if cell.has_overpotential else []
    )
    ocv = np.tile(cell.ocv, (1, cell.n_t))
    value, by_soc, by_temperature, by_both = -cell.circuit[:, order]
    rows = [ocv[:1], value, ocv[1:], by_soc]
    if cell.n_t > 1:
        rows += [by_temperature, np.zeros_like(ocv[:1]), by_both]
    return np.ascontiguousarray(np.concatenate(rows)), 1 + len(order)
