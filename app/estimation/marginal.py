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

The compiled engine computes the same sums in the same order, so that both round alike. Results go to arrays that are
kept, because at 96 cells a call of numpy costs more than its arithmetic.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.estimation.inputs import StepInput
from app.estimation.outputs import SigmaOutput, TangentOutput
from app.estimation.process import SOC_VARIANCE_MAX
from app.estimation.sigma_points import SigmaRule
from app.estimation.states import SOC, CellStates
from app.estimation.tables import PackedCell
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SOC_MIN: Final = -0.05  # the mean is held here
SOC_MAX: Final = 1.05


class StepResult(NamedTuple):
    """What the update saw, (n,) each, good until the next one.

    Attributes:
        slope_v: dOCV/dSOC [V].
        accepted: which samples were used.
        all_accepted: whether all were.
    """

    slope_v: FloatArray
    accepted: BoolArray
    all_accepted: bool


class MarginalFilter:
    """Conditions the states of one cell model on voltages; `rule` None makes it the extended Kalman filter."""

    def __init__(self, cell: PackedCell, states: CellStates, rule: SigmaRule | None, tuning: Tuning) -> None:
        self._hysteresis_v = cell.model.hysteresis_v
        self._states = states
        self._tuning = tuning
        self._output = SigmaOutput(cell, states, rule) if rule else TangentOutput(cell, states)
        d, n = states.mean.shape
        self._gate_v2 = np.array(tuning.gate * tuning.gate)
        PH, HPH, H = np.empty((d, d, n)), np.empty((d, n)), self._output.slopes
        self._H_views = H, H[:, None], PH, list(PH), HPH, list(HPH)
        seen, gain = np.empty((1 + d, n)), np.empty((1 + d, n))  # minus the innovation, then P_xy; the same / sqrt(S)
        self._gain_views = seen, seen[0], seen[1:], gain, gain[:, None], gain[1:], np.empty((1 + d, d, n))
        self._soc = states.mean[SOC]
        self._slope = self._output.ocv_slope_v
        self._expected, self._total, self._limit, self._square = np.empty((4, n))

    def update(
        self, step: StepInput, predicted: FloatArray, innovation: FloatArray, innovation_sigma: FloatArray
    ) -> StepResult:
        """Condition the state on one sample of voltages, in place.

        Args:
            step: the sample.
            predicted: (n,) where the predicted voltage goes [V].
            innovation: (n,) likewise measured minus predicted [V].
            innovation_sigma: (n,) likewise its standard deviation [V].
        """
        states, expected, total = self._states, self._expected, self._total
        Pyy = self._output.at(step, predicted)
        if self._hysteresis_v:
            predicted += self._hysteresis_v * states.hysteresis
        # P_xy = P H,  P_yy = H P H + k q^2
        H, H_column, PH, PH_rows, HPH, HPH_rows = self._H_views
        seen, seen_first, Pxy, gain, gain_column, z, change = self._gain_views
        np.multiply(states.cov, H_column, PH)
        if len(PH_rows) == 1:
            np.copyto(Pxy, PH)
        else:
            np.add(PH_rows[0], PH_rows[1], Pxy)
            for row in PH_rows[2:]:
                np.add(Pxy, row, Pxy)
        np.multiply(H, Pxy, HPH)
        for row in HPH_rows:
            np.add(Pyy, row, Pyy)
        model_v2 = self._model_variance(step)
        np.add(Pyy, model_v2, expected)
        np.add(Pyy, model_v2 * step.correlation, total)
        np.subtract(step.voltage_v, predicted, innovation)
        np.sqrt(expected, innovation_sigma)
        accepted, all_accepted = self._gate(step, innovation)
        # x' = x + P_xy nu / S,  P' = P - P_xy P_xy' / S: with z = P_xy / sqrt(S) it stays symmetric to the last bit
        np.negative(innovation, seen_first)
        np.sqrt(total, total)
        np.reciprocal(total, total)
        np.multiply(seen, total, gain)
        if not all_accepted:
            gain[:, ~accepted] = 0.0
        np.multiply(gain_column, z, change)
        np.subtract(states.gaussian, change, states.gaussian)
        soc = self._soc
        if soc.item(soc.argmin()) < SOC_MIN or soc.item(soc.argmax()) > SOC_MAX:
            np.maximum(soc, SOC_MIN, out=soc)
            np.minimum(soc, SOC_MAX, out=soc)
        return StepResult(self._slope, accepted, all_accepted)

    def _model_variance(self, step: StepInput) -> FloatArray | float:
        """Return the variance of the model's error [V^2]: it grows below `empty_soc` and outside the tables."""
        tuning, soc = self._tuning, self._soc
        if soc.item(soc.argmin()) >= tuning.empty_soc:
            return step.noise_v2 if step.climate.is_inside else np.multiply(step.climate.noise_scale, step.noise_v2)
        low: FloatArray = np.maximum(tuning.empty_soc - soc, 0.0)
        low *= (tuning.empty_factor - 1.0) / tuning.empty_soc
        low += 1.0
        low *= step.climate.noise_scale
        low *= step.noise_v2
        return low

    def _gate(self, step: StepInput, innovation: FloatArray) -> tuple[BoolArray, bool]:
        """Return (n,) which samples to use, and whether all: inside the gate, or outside it for too long."""
        tuning, refused_s = self._tuning, self._states.refused_s
        np.multiply(innovation, innovation, self._square)
        np.multiply(self._expected, self._gate_v2, self._limit)
        inside = np.less_equal(self._square, self._limit)
        if inside.item(inside.argmin()):
            refused_s.fill(0.0)
            return inside, True
        missing = np.isnan(innovation)
        refused = ~inside & ~missing
        refused_s[:] = np.where(refused, refused_s + step.dt_s, np.where(missing, refused_s, 0.0))
        believed = refused & (refused_s > tuning.gate_hold_s)
        Pz = self._states.cov[SOC, SOC]
        widened = np.minimum(Pz + tuning.gate_recovery * tuning.gate_recovery * step.dt_s, SOC_VARIANCE_MAX)
        Pz[:] = np.where(believed, np.maximum(widened, Pz), Pz)
        return inside | believed, False
