"""The marginalised sigma-point filter over all cells at once, in numpy.

State of a cell: x = [SOC, i_1 .. i_m], the currents through the RC resistors. The process is linear; the output
is nonlinear in SOC only and, at a given SOC, linear in the currents. With SOC first in the Cholesky factor only
the centre and the two points along its first column see another SOC; every other pair lies symmetrically on a
straight line. So three look-ups and closed-form algebra give the numbers of the full set:

    r    = R_k(z)                                    minus the output per RC current
    D    = (h+ - h-) / (2 c s),  s = sqrt(P_zz)      statistical slope along the first column
    q    = h+ + h- - 2 h0,       y = h0 + w q
    H    = [D + p r / P_zz, -r]                      p = P_zi
    P_xy = P H,                  P_yy = H P H + k q^2

The update P - P_xy P_xy' / S cannot lose definiteness: S - P_xy' P^-1 P_xy = R + k q^2 > 0, and R is never below
the model's own variance, 1e-4 V^2, so that rounding cannot either. An EKF is the same algebra with H the tangent
and q = 0.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.estimation.circuit import SECONDS_PER_HOUR
from app.estimation.sigma_points import SigmaRule
from app.estimation.states import SOC, CellStates
from app.estimation.tables import BRANCH, PackedCell
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

SOC_VARIANCE_MAX: Final = 0.25  # no cell's SOC is less known than this
VARIANCE_STEP: Final = 1e-12  # added at every step, in units of 1 and C^2: the floor of definiteness
SOC_MIN: Final = -0.05  # the mean is held here
SOC_MAX: Final = 1.05


Transition = tuple[FloatArray, FloatArray, FloatArray, FloatArray]  # (d, 1) or (d, n); the second (d, d, ..)


class StepInput(NamedTuple):
    """What one step needs besides the state.

    Attributes:
        dt_s: step [s].
        current_a: held current [A].
        noise_v2: variance of the voltage's model error, without correlation [V^2].
        correlation: growth of it for the gain.
        noise_scale: (n,) growth of it with temperature.
        voltage_v: (n,) [V], NaN = missing.
        row: (n,) table row of the temperature.
        row_weight: (n,) weight of the next row.
        row3: (3 n,) `row` three times, for the three sigma points.
        row3_weight: (3 n,) likewise.
    """

    dt_s: float
    current_a: float
    noise_v2: float
    correlation: float
    noise_scale: FloatArray
    voltage_v: FloatArray
    row: IntArray
    row_weight: FloatArray
    row3: IntArray
    row3_weight: FloatArray


class StepResult(NamedTuple):
    """What the update saw, (n,) each; `slope_v` is dv/dSOC at held RC currents."""

    predicted_v: FloatArray
    innovation_v: FloatArray
    innovation_sigma_v: FloatArray
    slope_v: FloatArray
    accepted: BoolArray
    all_accepted: bool


class MarginalFilter:
    """Predict and update for one cell model and one rule; `rule` None makes it the extended Kalman filter."""

    def __init__(self, cell: PackedCell, rule: SigmaRule | None, tuning: Tuning) -> None:
        self.cell = cell
        self.rule = rule
        self.tuning = tuning
        self._transition_dt_s = -1.0
        self._kept_transition: Transition

    def moved_soc(self, current_a: float, dt_s: float) -> float:
        """Return the share of the capacity that a held current takes out; charging counts times the efficiency."""
        model = self.cell.model
        kept = model.coulombic_efficiency if current_a < 0.0 else 1.0
        return kept * current_a * dt_s / (SECONDS_PER_HOUR * model.capacity_ah)

    def predict(self, state: CellStates, step: StepInput) -> None:
        """Move the state over one step of held current, in place."""
        tuning, model, x, P = self.tuning, self.cell.model, state.mean, state.cov
        moved = self.moved_soc(step.current_a, step.dt_s)
        if model.hysteresis_v:
            follow = math.exp(-model.hysteresis_rate * abs(moved))
            state.hysteresis *= follow
            state.hysteresis -= math.copysign(1.0 - follow, moved)
        A, AA, rest, rest2 = self._transition(state, step)
        branch_variance = (tuning.branch_rel * step.current_a) ** 2 + (tuning.branch_c * model.c_rate_a) ** 2
        Q = rest2 * branch_variance
        Q += VARIANCE_STEP * model.c_rate_a**2
        Q[SOC] = self._walk(step.dt_s)
        B = rest * step.current_a
        B[SOC] = -moved
        # x' = A x + B i,  P' = A P A' + Q
        x *= A
        x += B
        P *= AA
        diagonal = P.reshape(-1, state.n_cells)[:: x.shape[0] + 1]
        diagonal += Q

    def update(self, state: CellStates, step: StepInput) -> StepResult:
        """Condition the state on one sample of voltages, in place."""
        tuning, x, P = self.tuning, state.mean, state.cov
        predicted, steep, kq2, r = self._output(state, step)
        # P_xy = P H,  P_yy = H P H + k q^2 with H = [D + p r / P_zz, -r]
        H = np.empty_like(x)
        H[SOC] = steep
        np.negative(r, out=H[1:])
        Pxy = np.einsum("ikn,kn->in", P, H)
        Pyy = kq2
        Pyy += np.einsum("kn,kn->n", H, Pxy)
        low = np.maximum(tuning.empty_soc - x[SOC], 0.0)
        low *= (tuning.empty_factor - 1.0) / tuning.empty_soc * step.noise_v2
        low += step.noise_v2
        model_v2 = low * step.noise_scale
        innovation = step.voltage_v - predicted
        expected = Pyy + model_v2
        accepted, all_accepted = self._gate(state, step, innovation, expected)
        # x' = x + P_xy nu / S,  P' = P - P_xy P_xy' / S: with z = P_xy / sqrt(S) it stays symmetric to the last bit
        root = 1.0 / np.sqrt(Pyy + model_v2 * step.correlation)
        if all_accepted:
            z = Pxy * root
            x += z * (innovation * root)
        else:
            z = np.where(accepted, Pxy * root, 0.0)
            x += z * np.where(accepted, innovation * root, 0.0)
        P -= z[:, None] * z
        soc = x[SOC]
        np.maximum(soc, SOC_MIN, out=soc)
        np.minimum(soc, SOC_MAX, out=soc)
        return StepResult(predicted, innovation, np.sqrt(expected), steep, accepted, all_accepted)

    def _walk(self, dt_s: float) -> float:
        return min(self.tuning.soc_walk**2 * dt_s, SOC_VARIANCE_MAX) + VARIANCE_STEP

    def _transition(self, state: CellStates, step: StepInput) -> Transition:
        """Return A, what multiplies P (it holds the SOC's variance as well), 1 - A and 1 - A^2."""
        tau = self.cell.tau_fixed_s
        if tau is not None and step.dt_s == self._transition_dt_s:
            return self._kept_transition
        if tau is not None:
            A = np.concatenate(([1.0], np.exp(-step.dt_s / tau)))[:, None]
        else:
            j, f = self.cell.place_soc(state.mean[SOC])
            slow = self.cell.tau_at(j, f, step.row, step.row_weight)
            A = np.concatenate((np.ones((1, state.n_cells)), np.exp(-step.dt_s / slow)))
        keep = A.copy()
        keep[SOC] = math.sqrt(max(1.0 - self._walk(step.dt_s) / SOC_VARIANCE_MAX, 0.0))
        self._transition_dt_s = step.dt_s
        self._kept_transition = A, keep[:, None] * keep, 1.0 - A, 1.0 - A * A
        return self._kept_transition

    def _output(self, state: CellStates, step: StepInput) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return mean output [V], D + p r / P_zz [V], k q^2 [V^2] and r (n_rc, n) [ohm]."""
        if self.rule is None:
            return self._tangent(state, step)
        cell, x, P, rule = self.cell, state.mean, state.cov, self.rule
        n = state.n_cells
        per_sd = rule.spread / np.sqrt(P[SOC, SOC])
        shift = P[SOC] * per_sd
        points = np.empty((x.shape[0], 3, n))
        points[:, 0] = x
        np.add(x, shift, out=points[:, 1])
        np.subtract(x, shift, out=points[:, 2])
        flat = points.reshape(-1, 3 * n)
        j, f = cell.place_soc(flat[SOC])
        c = cell.circuit_at(j, f, step.row3, step.row3_weight)
        h = cell.ocv_at(j, f)
        h -= cell.drop(c, step.current_a, flat[1:])
        h0, up, down = h.reshape(3, n)
        r = c[BRANCH : BRANCH + cell.model.n_rc, :n]
        q = up + down
        q -= 2.0 * h0
        mean = h0 + rule.weight * q
        if cell.model.hysteresis_v:
            mean += cell.model.hysteresis_v * state.hysteresis
        # D + p r / P_zz with p = shift P_zz / (c s)
        steep = (up - down) * 0.5
        for k in range(r.shape[0]):
            steep += shift[k + 1] * r[k]
        steep /= shift[SOC]
        q *= q
        q *= rule.curvature
        return mean, steep, q, r

    def _tangent(self, state: CellStates, step: StepInput) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        cell, x = self.cell, state.mean
        j, f = cell.place_soc(x[SOC])
        c = cell.circuit_at(j, f, step.row, step.row_weight)
        h = cell.ocv_at(j, f) - cell.drop(c, step.current_a, x[1:]) + cell.model.hysteresis_v * state.hysteresis
        slope = cell.circuit_slope_at(j, step.row, step.row_weight)
        steep = cell.ocv_slope_at(j, f) - cell.drop(slope, step.current_a, x[1:])
        return h, steep, np.zeros_like(h), c[BRANCH : BRANCH + cell.model.n_rc]

    def _gate(
        self, state: CellStates, step: StepInput, innovation: FloatArray, expected: FloatArray
    ) -> tuple[BoolArray, bool]:
        """Return (n,) which samples to use, and whether all: inside the gate, or outside it for too long."""
        tuning = self.tuning
        excess = innovation * innovation
        excess -= tuning.gate**2 * expected
        if np.maximum.reduce(excess) <= 0.0:
            state.refused_s.fill(0.0)
            return np.ones(excess.shape, dtype=np.bool_), True
        inside = excess <= 0.0
        missing = np.isnan(innovation)
        refused = ~inside & ~missing
        state.refused_s[:] = np.where(refused, state.refused_s + step.dt_s, np.where(missing, state.refused_s, 0.0))
        believed = refused & (state.refused_s > tuning.gate_hold_s)
        Pz = state.cov[SOC, SOC]
        widened = np.minimum(Pz + tuning.gate_recovery**2 * step.dt_s, SOC_VARIANCE_MAX)
        Pz[:] = np.where(believed, np.maximum(widened, Pz), Pz)
        return np.asarray(inside | believed), False
