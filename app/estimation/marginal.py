"""The marginalised sigma-point filter over all cells at once, in numpy.

State of a cell: x = [SOC, i_1 .. i_m], the currents through the RC resistors. The process is linear; the output
is nonlinear in SOC only and, at a given SOC, linear in the currents. With SOC first in the Cholesky factor only
the centre and the two points along its first column see another SOC; every other pair lies symmetrically on a
straight line. So three look-ups and closed-form algebra give the numbers of the full set:

    g    = -R_k(z)                                   output per RC current
    D    = (h+ - h-) / (2 c s),  s = sqrt(P_zz)      statistical slope along the first column
    q    = h+ + h- - 2 h0,       y = h0 + w q
    P_xy = P_xz (D - p g / P_zz) + P_xi g,           p = P_zi
    P_yy = P_zz D^2 + k q^2 + g P_ii g - (p g)^2 / P_zz

The update P - P_xy P_xy' / S cannot lose definiteness: S - P_xy' P^-1 P_xy = R + k q^2 > 0, and R is kept above
a millionth of P_yy, so rounding cannot either. An EKF is the same algebra with D from the tangent and q = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.circuit import SECONDS_PER_HOUR
from app.estimation.sigma_points import SigmaRule
from app.estimation.tables import BRANCH, OVERPOTENTIAL, R0, SOC_LOW, PackedCell
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SOC = 0
SOC_VARIANCE_MAX: Final = 0.25  # no cell's SOC is less known than this
SOC_VARIANCE_STEP: Final = 1e-12  # added every step, with its like for the currents: the floor of definiteness
NOISE_FLOOR_REL: Final = 1e-6  # least measurement variance, relative to P_yy
SOC_MIN, SOC_MAX = SOC_LOW + 0.05, 1.05  # the mean is held here


@dataclass
class FilterState:
    """Mean, covariance and gate of all cells.

    Attributes:
        mean: (d, n) SOC, then RC currents [A].
        cov: (d, d, n) covariance.
        hysteresis: (n,) hysteresis state, -1..1.
        refused_s: (n,) for how long the innovations have been refused without a break [s].
    """

    mean: FloatArray
    cov: FloatArray
    hysteresis: FloatArray
    refused_s: FloatArray


@dataclass(frozen=True)
class StepInput:
    """What one step needs besides the state, common numbers first.

    Attributes:
        dt_s: step [s].
        current_a: held current [A].
        noise_v2: variance of the voltage's model error, without correlation [V^2].
        correlation: growth of it for the gain.
        noise_scale: (n,) growth of it with temperature.
        voltage_v: (n,) [V], NaN = missing.
        row: (n,) table row of the temperature.
        row_weight: (n,) weight of the next row.
    """

    dt_s: float
    current_a: float
    noise_v2: float
    correlation: float
    noise_scale: FloatArray
    voltage_v: FloatArray
    row: NDArray[np.intp]
    row_weight: FloatArray


@dataclass(frozen=True)
class StepResult:
    """What the update saw, (n,) each: predicted output, innovation, its sigma, slope dv/dSOC, voltage used."""

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
        self._capacity_coulomb = SECONDS_PER_HOUR * cell.model.capacity_ah

    def predict(self, state: FilterState, step: StepInput) -> None:
        """Move the state over one step of held current, in place."""
        tuning, model, x, P = self.tuning, self.cell.model, state.mean, state.cov
        i, dt = step.current_a, step.dt_s
        kept = model.coulombic_efficiency if i < 0 else 1.0
        walk = min(tuning.soc_walk**2 * dt, SOC_VARIANCE_MAX) + SOC_VARIANCE_STEP
        moved = kept * i * dt / self._capacity_coulomb
        branch_variance = (tuning.branch_rel * i) ** 2 + (tuning.branch_c * model.c_rate_a) ** 2
        if model.hysteresis_v:
            follow = np.exp(-model.hysteresis_rate * abs(moved))
            state.hysteresis = follow * state.hysteresis - (1.0 - follow) * np.sign(moved)
        # x' = A x + B i,  P' = A P A' + Q
        x[SOC] -= moved
        if model.n_rc:
            decay = self._decay(state, step)
            x[1:] = decay * x[1:] + (1.0 - decay) * i
            P[1:] *= decay[:, None]
            P[:, 1:] *= decay
            for k in range(model.n_rc):
                P[k + 1, k + 1] += (1.0 - decay[k] ** 2) * branch_variance + SOC_VARIANCE_STEP * model.c_rate_a**2
        shrink = np.sqrt(max(1.0 - walk / SOC_VARIANCE_MAX, 0.0))
        P[SOC] *= shrink
        P[:, SOC] *= shrink
        P[SOC, SOC] += walk

    def update(self, state: FilterState, step: StepInput) -> StepResult:
        """Condition the state on one sample of voltages, in place."""
        tuning, x, P = self.tuning, state.mean, state.cov
        Pz = P[SOC, SOC]
        predicted, slope, q2, g = self._output(state, step)
        # acc = P_xi g,  pg = P_zi g
        acc = np.zeros_like(x)
        for k in range(g.shape[0]):
            acc += P[:, k + 1] * g[k]
        pg = acc[SOC]
        Pxy = P[SOC] * (slope - pg / Pz) + acc
        Pyy = Pz * slope * slope + q2 + (g * acc[1:]).sum(axis=0) - pg * pg / Pz
        low = np.maximum(tuning.empty_soc - x[SOC], 0.0) * ((tuning.empty_factor - 1.0) / tuning.empty_soc)
        model_v2 = step.noise_v2 * step.noise_scale * (1.0 + low)
        R = np.maximum(model_v2 * step.correlation + tuning.sensor_v**2, NOISE_FLOOR_REL * Pyy)
        innovation = step.voltage_v - predicted
        expected = Pyy + model_v2 + tuning.sensor_v**2
        accepted = self._gate(state, step, innovation, expected)
        S = Pyy + R
        root = np.sqrt(S)
        z = np.where(accepted, Pxy / root, 0.0)
        x += z * np.where(accepted, innovation / root, 0.0)
        P -= z[:, None] * z
        x[SOC] = np.minimum(np.maximum(x[SOC], SOC_MIN), SOC_MAX)
        return StepResult(predicted, innovation, np.sqrt(expected), slope, accepted)

    def _decay(self, state: FilterState, step: StepInput) -> FloatArray:
        cell = self.cell
        if cell.tau_fixed_s is not None:
            return np.asarray(np.exp(-step.dt_s / cell.tau_fixed_s)[:, None])
        j, f = cell.place_soc(state.mean[SOC])
        return np.asarray(np.exp(-step.dt_s / cell.tau_at(j, f, step.row, step.row_weight)))

    def _output(self, state: FilterState, step: StepInput) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return mean output [V], slope D [V], k q^2 [V^2] and g (n_rc, n) [ohm], negative."""
        cell, x, P, rule = self.cell, state.mean, state.cov, self.rule
        i = step.current_a
        over = np.arcsinh(i / cell.model.overpotential_current_a)
        sd = np.sqrt(P[SOC, SOC])
        offset = cell.model.hysteresis_v * state.hysteresis
        if rule is None:
            j, f = cell.place_soc(x[SOC])
            c = cell.circuit_at(j, f, step.row, step.row_weight)
            h0 = cell.ocv_at(j, f) - i * c[R0] - over * c[OVERPOTENTIAL] - (c[BRANCH:] * x[1:]).sum(axis=0) + offset
            dc = cell.circuit_slope_at(j, step.row, step.row_weight)
            pair = cell.ocv_slope.take(j, axis=1)
            tangent = pair[0] + f * pair[1] - i * dc[R0] - over * dc[OVERPOTENTIAL] - (dc[BRANCH:] * x[1:]).sum(axis=0)
            g = -c[BRANCH:]
            pg = (g * P[SOC, 1:]).sum(axis=0)
            return h0, tangent + pg / P[SOC, SOC], np.zeros_like(h0), g
        n = sd.size
        reach = rule.spread * sd
        points = np.concatenate((x[SOC], x[SOC] + reach, x[SOC] - reach))
        j, f = cell.place_soc(points)
        c = cell.circuit_at(j, f, np.tile(step.row, 3), np.tile(step.row_weight, 3))
        shift = P[SOC, 1:] * (rule.spread / sd)
        branch = np.concatenate((x[1:], x[1:] + shift, x[1:] - shift), axis=1)
        h = cell.ocv_at(j, f) - i * c[R0] - over * c[OVERPOTENTIAL] - (c[BRANCH:] * branch).sum(axis=0)
        h0, up, down = h[:n] + offset, h[n : 2 * n] + offset, h[2 * n :] + offset
        q = up + down - 2.0 * h0
        return h0 + rule.weight * q, (up - down) / (2.0 * reach), rule.curvature * q * q, -c[BRANCH:, :n]

    def _gate(self, state: FilterState, step: StepInput, innovation: FloatArray, expected: FloatArray) -> BoolArray:
        tuning = self.tuning
        inside = innovation * innovation <= tuning.gate**2 * expected
        missing = np.isnan(innovation)
        if inside.all():
            state.refused_s = np.zeros_like(state.refused_s)
            return np.asarray(inside)
        refused = ~inside & ~missing
        state.refused_s = np.where(refused, state.refused_s + step.dt_s, np.where(missing, state.refused_s, 0.0))
        believed = refused & (state.refused_s > tuning.gate_hold_s)
        widened = np.minimum(state.cov[SOC, SOC] + tuning.gate_recovery**2 * step.dt_s, SOC_VARIANCE_MAX)
        state.cov[SOC, SOC] = np.where(believed, np.maximum(widened, state.cov[SOC, SOC]), state.cov[SOC, SOC])
        return np.asarray(inside | believed)
