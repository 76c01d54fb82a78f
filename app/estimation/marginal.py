"""The marginalised sigma-point filter over all cells at once, in numpy.

State of a cell: x = [SOC, i_1 .. i_m], the currents through the RC resistors. The process is linear; the output
is nonlinear in SOC only and, at a given SOC, linear in the currents. With SOC first in the Cholesky factor only
the centre and the two points along its first column see another SOC; every other pair lies symmetrically on a
straight line. So three look-ups and closed-form algebra give the numbers of the full set:

    r    = R_k(z)                                    minus the output per RC current
    D    = (h+ - h-) / (2 c s),  s = sqrt(P_zz)      statistical slope along the first column
    q    = h+ + h- - 2 h0,       y = h0 + w q
    P_xy = P_xz (D + p r / P_zz) - P_xi r,           p = P_zi
    P_yy = P_zz D^2 + k q^2 + r P_ii r - (p r)^2 / P_zz

The update P - P_xy P_xy' / S cannot lose definiteness: S - P_xy' P^-1 P_xy = R + k q^2 > 0, and R is kept above
a millionth of P_yy, so rounding cannot either. An EKF is the same algebra with D from the tangent and q = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.circuit import SECONDS_PER_HOUR
from app.estimation.sigma_points import SigmaRule
from app.estimation.states import SOC, CellStates
from app.estimation.tables import BRANCH, OVERPOTENTIAL, R0, PackedCell
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

SOC_VARIANCE_MAX: Final = 0.25  # no cell's SOC is less known than this
VARIANCE_STEP: Final = 1e-12  # added at every step, in units of 1 and C^2: the floor of definiteness
NOISE_FLOOR_REL: Final = 1e-6  # least measurement variance, relative to P_yy
SOC_MIN: Final = -0.05  # the mean is held here
SOC_MAX: Final = 1.05


@dataclass(frozen=True)
class StepInput:
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


@dataclass(frozen=True)
class StepResult:
    """What the update saw, (n,) each; `slope_v` is dv/dSOC at held RC currents."""

    predicted_v: FloatArray
    innovation_v: FloatArray
    innovation_sigma_v: FloatArray
    slope_v: FloatArray
    accepted: BoolArray


class MarginalFilter:
    """Predict and update for one cell model and one rule; `rule` None makes it the extended Kalman filter."""

    def __init__(self, cell: PackedCell, rule: SigmaRule | None, tuning: Tuning) -> None:
        self.cell = cell
        self.rule = rule
        self.tuning = tuning
        self._decay_key = -1.0
        self._decay = np.ones((1 + cell.model.n_rc, 1))
        self._decay_outer = self._decay[:, None] * self._decay

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
        A, AA = self._transition(state, step)
        branch_variance = (tuning.branch_rel * step.current_a) ** 2 + (tuning.branch_c * model.c_rate_a) ** 2
        Q = (1.0 - A * A) * branch_variance + VARIANCE_STEP * model.c_rate_a**2
        Q[SOC] = min(tuning.soc_walk**2 * step.dt_s, SOC_VARIANCE_MAX) + VARIANCE_STEP
        B = (1.0 - A) * step.current_a
        B[SOC] = -moved
        # x' = A x + B i,  P' = A P A' + Q
        x *= A
        x += B
        P *= AA
        for k in range(x.shape[0]):
            P[k, k] += Q[k]

    def update(self, state: CellStates, step: StepInput) -> StepResult:
        """Condition the state on one sample of voltages, in place."""
        tuning, x, P = self.tuning, state.mean, state.cov
        Pz = P[SOC, SOC]
        predicted, slope, kq2, r = self._output(state, step)
        # acc = P_xi r,  acc[SOC] = p r
        acc = np.zeros_like(x)
        for k in range(r.shape[0]):
            acc += P[k + 1] * r[k]
        lean = acc[SOC] / Pz
        Pxy = P[SOC] * (slope + lean) - acc
        Pyy = Pz * slope * slope + kq2 - lean * acc[SOC]
        for k in range(r.shape[0]):
            Pyy += r[k] * acc[k + 1]
        low = np.maximum(tuning.empty_soc - x[SOC], 0.0) * ((tuning.empty_factor - 1.0) / tuning.empty_soc) + 1.0
        model_v2 = low * step.noise_scale * step.noise_v2
        R = np.maximum(model_v2 * step.correlation + tuning.sensor_v**2, NOISE_FLOOR_REL * Pyy)
        innovation = step.voltage_v - predicted
        expected = Pyy + model_v2 + tuning.sensor_v**2
        accepted = self._gate(state, step, innovation, expected)
        # x' = x + P_xy nu / S,  P' = P - P_xy P_xy' / S: with z = P_xy / sqrt(S) it stays symmetric to the last bit
        root = np.sqrt(Pyy + R)
        if accepted.all():
            z = Pxy / root
            x += z * (innovation / root)
        else:
            z = np.where(accepted, Pxy / root, 0.0)
            x += z * np.where(accepted, innovation / root, 0.0)
        P -= z[:, None] * z
        np.clip(x[SOC], SOC_MIN, SOC_MAX, out=x[SOC])
        return StepResult(predicted, innovation, np.sqrt(expected), slope + lean, accepted)

    def _transition(self, state: CellStates, step: StepInput) -> tuple[FloatArray, FloatArray]:
        """Return A (d, 1) or (d, n) and what multiplies P; the SOC's share is 1 in A and holds its variance in P."""
        tau = self.cell.tau_fixed_s
        if tau is not None and step.dt_s == self._decay_key:
            return self._decay, self._decay_outer
        if tau is not None:
            self._decay_key = step.dt_s
            A = np.concatenate(([1.0], np.exp(-step.dt_s / tau)))[:, None]
        else:
            j, f = self.cell.place_soc(state.mean[SOC])
            slow = self.cell.tau_at(j, f, step.row, step.row_weight)
            A = np.concatenate((np.ones((1, state.n_cells)), np.exp(-step.dt_s / slow)))
        walk = min(self.tuning.soc_walk**2 * step.dt_s, SOC_VARIANCE_MAX) + VARIANCE_STEP
        keep = A.copy()
        keep[SOC] = math.sqrt(max(1.0 - walk / SOC_VARIANCE_MAX, 0.0))
        self._decay, self._decay_outer = A, keep[:, None] * keep
        return self._decay, self._decay_outer

    def _output(self, state: CellStates, step: StepInput) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return mean output [V], slope D [V], k q^2 [V^2] and r (n_rc, n) [ohm]."""
        if self.rule is None:
            return self._tangent(state, step)
        cell, x, P, rule = self.cell, state.mean, state.cov, self.rule
        n = state.n_cells
        sd = np.sqrt(P[SOC, SOC])
        reach = rule.spread * sd
        d = x.shape[0]
        points = np.empty((d, 3, n))
        points[:, 0] = x
        shift = P[SOC] * (rule.spread / sd)
        np.add(x, shift, out=points[:, 1])
        np.subtract(x, shift, out=points[:, 2])
        flat = points.reshape(d, 3 * n)
        j, f = cell.place_soc(flat[SOC])
        c = cell.circuit_at(j, f, step.row3, step.row3_weight)
        h = cell.ocv_at(j, f)
        h -= step.current_a * c[R0]
        if cell.has_overpotential:
            h -= math.asinh(step.current_a / cell.model.overpotential_current_a) * c[OVERPOTENTIAL]
        for k in range(d - 1):
            h -= c[BRANCH + k] * flat[k + 1]
        h0, up, down = h.reshape(3, n)
        q = up + down - 2.0 * h0
        mean = h0 + rule.weight * q
        if cell.model.hysteresis_v:
            mean += cell.model.hysteresis_v * state.hysteresis
        return mean, (up - down) / (2.0 * reach), rule.curvature * q * q, c[BRANCH:, :n]

    def _tangent(self, state: CellStates, step: StepInput) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        cell, x, P = self.cell, state.mean, state.cov
        i = step.current_a
        over = math.asinh(i / cell.model.overpotential_current_a)
        j, f = cell.place_soc(x[SOC])
        c = cell.circuit_at(j, f, step.row, step.row_weight)
        dc = cell.circuit_slope_at(j, step.row, step.row_weight)
        r = c[BRANCH:]
        h = cell.ocv_at(j, f) - i * c[R0] - over * c[OVERPOTENTIAL] - (r * x[1:]).sum(axis=0)
        h += cell.model.hysteresis_v * state.hysteresis
        tangent = cell.ocv_slope_at(j, f) - i * dc[R0] - over * dc[OVERPOTENTIAL] - (dc[BRANCH:] * x[1:]).sum(axis=0)
        slope = tangent - (r * P[SOC, 1:]).sum(axis=0) / P[SOC, SOC]
        return h, slope, np.zeros_like(h), r

    def _gate(self, state: CellStates, step: StepInput, innovation: FloatArray, expected: FloatArray) -> BoolArray:
        """Return (n,) which samples to use: inside the gate, or outside for so long that the state must be wrong."""
        tuning = self.tuning
        inside = np.asarray(innovation * innovation <= tuning.gate**2 * expected)
        if inside.all():
            state.refused_s[:] = 0.0
            return inside
        missing = np.isnan(innovation)
        refused = ~inside & ~missing
        state.refused_s[:] = np.where(refused, state.refused_s + step.dt_s, np.where(missing, state.refused_s, 0.0))
        believed = refused & (state.refused_s > tuning.gate_hold_s)
        Pz = state.cov[SOC, SOC]
        widened = np.minimum(Pz + tuning.gate_recovery**2 * step.dt_s, SOC_VARIANCE_MAX)
        Pz[:] = np.where(believed, np.maximum(widened, Pz), Pz)
        return np.asarray(inside | believed)
