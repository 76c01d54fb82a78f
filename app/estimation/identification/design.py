"""The linear part of the identification: which columns explain the voltage of a cell once time constants are fixed.

    OCV(z) - v = R0 i + e asinh(i / i_ref) + sum R_k i_k - lambda (V_charge - V_discharge) - delta

R0, R_k, e and delta are tables over SOC and temperature, lambda is one over SOC. Between the temperatures of the tests
R0, R_k and e follow exp(E / R (1/T - 1/T_ref)) with the usual activation energy, corrected linearly in 1/T.
Every coefficient but delta is non-negative. Source: the circuit of `circuit.py`, solved for its resistances.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray, IntArray
from app.estimation.cell_model.circuit import GAS_CONSTANT, KELVIN
from app.estimation.identification.parts import REST_CURRENT_C, Part, current_between, has_soc_column
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.identification.solvers import first_order

REFERENCE_DEGC: Final = 25.0
RESISTANCE_SOC: Final = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
OVERPOTENTIAL_SOC: Final = np.array([0.0, 0.2, 0.5, 1.0])
BLEND_SOC: Final = np.array([0.0, 1.0])
OFFSET_SOC: Final = np.linspace(0.0, 1.0, 11)
DEFAULT_ACTIVATION_J_MOL: Final = 25e3
VOLTAGE_SIGMA_V: Final = 0.005  # the size of error the priors of the fit are weighed against
PART_WEIGHT: Final = 2000.0  # samples of that size that each recording counts for
BLOCK_S: Final = 30.0
BLOCK_WEIGHT: Final = 3.0
STEP_LIMIT_S: Final = 1.0  # a sample counts for the time it stands for, up to this
RECENT_S: Final = 120.0  # after so long without current ...
REST_WEIGHT: Final = 0.1  # ... a resting sample says little new
LAID_WEIGHT: Final = 0.1  # of a recording without a soc column: its SOC, laid on its rests, is less sure
ROWS_LIMIT: Final = 10_000


def hat_weights(knots: FloatArray, x: FloatArray) -> FloatArray:
    """Return (n, n_knots) weights of linear interpolation at x, held at the ends; every row sums to 1."""
    j = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, knots.size - 2)
    share = np.clip((x - knots[j]) / (knots[j + 1] - knots[j]), 0.0, 1.0)
    weights = np.zeros((x.size, knots.size))
    rows = np.arange(x.size)
    weights[rows, j] = 1.0 - share
    weights[rows, j + 1] = share
    return weights


def arrhenius(temperature_degc: FloatArray, activation_j_mol: float) -> FloatArray:
    """Return exp(E / R (1/T - 1/T_ref)): 1 at 25 degC, above 1 in the cold."""
    inverse = 1.0 / (temperature_degc + KELVIN) - 1.0 / (REFERENCE_DEGC + KELVIN)
    return np.asarray(np.exp(activation_j_mol / GAS_CONSTANT * inverse))


def temperature_weights(knots_degc: FloatArray, temperature_degc: FloatArray) -> FloatArray:
    """Return (n, n_knots) weights of interpolation linear in 1/T, held at the ends."""
    if knots_degc.size == 1:
        return np.ones((temperature_degc.size, 1))
    return hat_weights(-1.0 / (knots_degc + KELVIN), -1.0 / (temperature_degc + KELVIN))


def branch_current(time_s: FloatArray, current_a: FloatArray, tau_s: float) -> FloatArray:
    """Return the (n,) current through an RC resistor [A], from rest, driven by the mean of neighbouring samples."""
    decay = np.exp(-np.diff(time_s, prepend=time_s[:1]) / tau_s)
    return first_order(decay, (1.0 - decay) * current_between(time_s, current_a))


class Design:
    """The columns of one part for one grid of time constants, compressed to what least squares needs.

    Two sets of rows enter: every sample, which tells fast from slow, and means over `BLOCK_S`, which hold the slow
    errors that a filter would take for charge. Rows count by the SOC error their voltage error stands for.
    """

    def __init__(self, part: Part, slow: SlowCurves, capacity_ah: float, knots_degc: FloatArray) -> None:
        r = part.recording
        self._weight = _row_weights(part, slow, capacity_ah)
        used = np.flatnonzero(self._weight > 0.0)
        self._rows = used[:: max(-(-used.size // ROWS_LIMIT), 1)]
        rows = self._rows
        self.weight = self._weight[rows] / self._weight[rows].sum()
        self._part_weight = PART_WEIGHT * (1.0 if has_soc_column(r) else LAID_WEIGHT)
        soc = part.soc[rows]
        temperature = r.temperature_degc[rows]
        temperature = np.where(np.isnan(temperature), REFERENCE_DEGC, temperature)
        by_degc = temperature_weights(knots_degc, temperature)
        self._n_knots = knots_degc.size
        self._knots = np.flatnonzero(by_degc.any(axis=0))  # a test at one temperature says nothing of the others
        by_degc = by_degc[:, self._knots]
        resists = by_degc * arrhenius(temperature, DEFAULT_ACTIVATION_J_MOL)[:, None]
        self._hats = _products(resists, hat_weights(RESISTANCE_SOC, soc))
        self._current = r.current_a[rows]
        over = np.arcsinh(self._current / capacity_ah)
        self._over = _products(resists, hat_weights(OVERPOTENTIAL_SOC, soc) * over[:, None])
        gap_v = np.interp(soc, slow.soc, slow.charge_v - slow.discharge_v)
        shift = _products(by_degc, hat_weights(OFFSET_SOC, soc))
        self._fixed = -np.hstack((hat_weights(BLEND_SOC, soc) * gap_v[:, None], shift))
        self.target = np.interp(soc, slow.soc, slow.discharge_v) - r.voltage_v[rows]
        self._recording = r
        self._branches: dict[float, FloatArray] = {}
        block = np.floor((r.time_s[rows] - r.time_s[0]) / BLOCK_S)
        self._blocks = np.flatnonzero(np.diff(block, prepend=-1.0))

    def columns(self, tau_s: tuple[float, ...]) -> FloatArray:
        """Return the (rows, columns) matrix: R0, an R_k for every time constant, overpotential, blend, offset.

        All but the blend hold one set of columns over SOC for each temperature near the part's own.
        """
        parts = [self._hats * self._current[:, None]]
        parts += [self._hats * self._branch(tau)[:, None] for tau in tau_s]
        return np.hstack((*parts, self._over, self._fixed))

    def places(self, n_rc: int) -> IntArray:
        """Return where the columns stand among those of all temperatures."""
        first, found = 0, []
        for soc_knots in [RESISTANCE_SOC.size] * (1 + n_rc) + [OVERPOTENTIAL_SOC.size, 0, OFFSET_SOC.size]:
            if soc_knots == 0:
                found.append(first + np.arange(BLEND_SOC.size))
                first += BLEND_SOC.size
                continue
            found.append((first + self._knots[:, None] * soc_knots + np.arange(soc_knots)).ravel())
            first += self._n_knots * soc_knots
        return np.concatenate(found)

    def add_equations(
        self,
        gram: FloatArray,
        moment: FloatArray,
        tau_s: tuple[float, ...],
        columns: FloatArray,
        trust: FloatArray | None = None,
    ) -> None:
        """Add A' W A and A' W y over samples and blocks, in units of `VOLTAGE_SIGMA_V`, to those of all parts.

        Args:
            gram: (n, n) of the columns of all temperatures.
            moment: (n,) likewise.
            tau_s: time constants of the columns [s].
            columns: (rows, m) from `columns`.
            trust: (rows,) further weights in 0..1, of a robust fit.
        """
        places = self.places(len(tau_s))
        g, c = self.normal_equations(columns, trust)
        gram[np.ix_(places, places)] += g
        moment[places] += c

    def normal_equations(self, columns: FloatArray, trust: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Return A' W A and A' W y over samples and blocks, in units of `VOLTAGE_SIGMA_V`.

        Args:
            columns: (rows, n) from `columns`.
            trust: (rows,) further weights in 0..1, of a robust fit.
        """
        weight = self.weight if trust is None else self.weight * trust
        gram, moment = np.zeros((columns.shape[1],) * 2), np.zeros(columns.shape[1])
        total = np.maximum(np.add.reduceat(weight, self._blocks), 1e-300)
        means = np.add.reduceat(columns * weight[:, None], self._blocks, axis=0) / total[:, None]
        target_means = np.add.reduceat(self.target * weight, self._blocks) / total
        for matrix, target, w in (
            (columns, self.target, weight),
            (means, target_means, BLOCK_WEIGHT * total),
        ):
            scaled = matrix * (w * self._part_weight / VOLTAGE_SIGMA_V**2)[:, None]
            gram += scaled.T @ matrix
            moment += scaled.T @ target
        return gram, moment

    def _branch(self, tau_s: float) -> FloatArray:
        if tau_s not in self._branches:
            r = self._recording
            self._branches[tau_s] = branch_current(r.time_s, r.current_a, tau_s)[self._rows]
        return self._branches[tau_s]


def _products(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return (n, a b) the products of every column of (n, a) with every column of (n, b), those of b together."""
    return np.asarray((left[:, :, None] * right[:, None, :]).reshape(left.shape[0], -1))


def _row_weights(part: Part, slow: SlowCurves, capacity_ah: float) -> FloatArray:
    """Return (n,) weights: time, less in long rests, less where the OCV is steep and a volt means little charge."""
    r = part.recording
    weight = np.minimum(r.step_s, STEP_LIMIT_S)
    busy = np.abs(r.current_a) > REST_CURRENT_C * capacity_ah
    last = np.maximum.accumulate(np.where(busy, np.arange(busy.size), -1))
    since_s = np.where(last >= 0, r.time_s - r.time_s[np.maximum(last, 0)], np.inf)
    weight = weight * np.where(since_s < RECENT_S, 1.0, REST_WEIGHT)
    slope = np.gradient(slow.rested_v, slow.soc)
    steepness = np.interp(np.nan_to_num(part.soc), slow.soc, slope) / max(float(np.median(slope)), 1e-3)
    weight = weight / np.maximum(steepness, 1.0) ** 2
    return np.where(np.isfinite(part.soc) & np.isfinite(r.voltage_v), weight, 0.0)
