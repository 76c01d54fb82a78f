"""The linear part of the identification: which columns explain the voltage of a cell once time constants are fixed.

    OCV(z) - v = R0 i + e asinh(i / i_ref) + sum R_k i_k - lambda (V_charge - V_discharge) - delta

with R0, R_k, e, lambda and delta piecewise linear in SOC and R0, R_k, e scaled by exp(E / R (1/T - 1/T_ref)).
Every coefficient but delta is non-negative. Source: the circuit of `circuit.py`, solved for its resistances.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.identification.parts import REST_CURRENT_C, Part
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.identification.solvers import first_order

GAS_CONSTANT: Final = 8.314462618  # J/(mol K)
REFERENCE_DEGC: Final = 25.0
KELVIN: Final = 273.15
RESISTANCE_SOC: Final = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
OVERPOTENTIAL_SOC: Final = np.array([0.0, 0.2, 0.5, 1.0])
BLEND_SOC: Final = np.array([0.0, 1.0])
OFFSET_SOC: Final = np.linspace(0.0, 1.0, 11)
VOLTAGE_SIGMA_V: Final = 0.005  # the size of error the priors of the fit are weighed against
PART_WEIGHT: Final = 2000.0  # samples of that size that each recording counts for
BLOCK_S: Final = 30.0
BLOCK_WEIGHT: Final = 3.0
STEP_LIMIT_S: Final = 1.0  # a sample counts for the time it stands for, up to this
RECENT_S: Final = 120.0  # after so long without current ...
REST_WEIGHT: Final = 0.1  # ... a resting sample says little new
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


def branch_current(time_s: FloatArray, current_a: FloatArray, tau_s: float) -> FloatArray:
    """Return the (n,) current through an RC resistor [A], from rest, driven by the mean of neighbouring samples."""
    mean_a = current_a.copy()
    mean_a[1:] = 0.5 * (current_a[1:] + current_a[:-1])
    decay = np.exp(-np.diff(time_s, prepend=time_s[:1]) / tau_s)
    return first_order(decay, (1.0 - decay) * mean_a)


class Design:
    """The columns of one part for one grid of time constants, compressed to what least squares needs.

    Two sets of rows enter: every sample, which tells fast from slow, and means over `BLOCK_S`, which hold the slow
    errors that a filter would take for charge. Rows count by the SOC error their voltage error stands for.
    """

    def __init__(self, part: Part, slow: SlowCurves, capacity_ah: float) -> None:
        r = part.recording
        self._weight = _row_weights(part, slow, capacity_ah)
        used = np.flatnonzero(self._weight > 0.0)
        self._rows = used[:: max(-(-used.size // ROWS_LIMIT), 1)]
        rows = self._rows
        self.weight = self._weight[rows] / self._weight[rows].sum()
        soc = part.soc[rows]
        temperature = r.temperature_degc[rows]
        self._temperature = np.where(np.isnan(temperature), REFERENCE_DEGC, temperature)
        self._hats = hat_weights(RESISTANCE_SOC, soc)
        self._current = r.current_a[rows]
        over = np.arcsinh(self._current / capacity_ah)
        self._over = hat_weights(OVERPOTENTIAL_SOC, soc) * over[:, None]
        gap_v = np.interp(soc, slow.soc, slow.charge_v - slow.discharge_v)
        self._fixed = -np.hstack((hat_weights(BLEND_SOC, soc) * gap_v[:, None], hat_weights(OFFSET_SOC, soc)))
        self.target = np.interp(soc, slow.soc, slow.discharge_v) - r.voltage_v[rows]
        self._recording = r
        self._branches: dict[float, FloatArray] = {}
        block = np.floor((r.time_s[rows] - r.time_s[0]) / BLOCK_S)
        self._blocks = np.flatnonzero(np.diff(block, prepend=-1.0))

    def columns(self, tau_s: tuple[float, ...], activation_j_mol: tuple[float, float, float]) -> FloatArray:
        """Return the (rows, columns) matrix: R0, an R_k for every time constant, overpotential, blend, offset."""
        ohmic, branch, over = (arrhenius(self._temperature, e)[:, None] for e in activation_j_mol)
        parts = [self._hats * (ohmic * self._current[:, None])]
        parts += [self._hats * (branch * self._branch(tau)[:, None]) for tau in tau_s]
        return np.hstack((*parts, self._over * over, self._fixed))

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
            scaled = matrix * (w * PART_WEIGHT / VOLTAGE_SIGMA_V**2)[:, None]
            gram += scaled.T @ matrix
            moment += scaled.T @ target
        return gram, moment

    def _branch(self, tau_s: float) -> FloatArray:
        if tau_s not in self._branches:
            r = self._recording
            self._branches[tau_s] = branch_current(r.time_s, r.current_a, tau_s)[self._rows]
        return self._branches[tau_s]


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
