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

h+ and h- are taken from h0 on and without what r makes of the shift p c / s of the currents: what is left of
(h+ - h-) / (2 c s) is H_z itself, and no digits are lost where s is small.

The update P - P_xy P_xy' / S cannot lose definiteness: S - P_xy' P^-1 P_xy = R + k q^2 > 0, and R is never below
the model's own variance, 1e-4 V^2, so that rounding cannot either. An EKF is the same algebra with H the tangent
and q = 0.

The compiled engine computes the same sums in the same order, so that both round alike. Results go to arrays that are
kept and factors are written out, because at 96 cells a call of numpy costs more than its arithmetic.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.filters.inputs import StepInput
from app.estimation.filters.outputs import SigmaOutput, TangentOutput
from app.estimation.filters.process import SOC_VARIANCE_MAX
from app.estimation.filters.sigma_points import SigmaRule
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning

SOC_MIN: Final = -0.05  # the mean is held here
SOC_MAX: Final = 1.05


class MarginalFilter:
    """Conditions the states of one cell model on voltages; `rule` None makes it the extended Kalman filter."""

    def __init__(self, cell: PackedCell, states: CellStates, rule: SigmaRule | None, tuning: Tuning) -> None:
        self._states = states
        self._tuning = tuning
        self._output = output = SigmaOutput(cell, states, rule) if rule else TangentOutput(cell, states)
        self._hysteresis_v = cell.model.hysteresis_v
        d, n = states.mean.shape
        seen, gain = np.empty((2, 1 + d, n))  # minus the innovation, then P_xy; the same over sqrt(S)
        # a factor is written out for every product it has a part in, because a ufunc that broadcasts costs more
        columns, rows = np.empty((2, 1 + d, d, n))
        PH = columns[:d]
        self._product_views = output.slopes[:, None], rows[:d], PH, *PH[:1], list(PH[1:])
        self._seen_views = seen, seen[0], seen[1:]
        self._gain_views = gain, gain[:, None], gain[1:], columns, rows
        HPH = np.empty((d, n))
        self._term_views = np.empty(n), HPH, list(HPH)
        # of the model's error, then of the innovation; each without and with correlation
        self._noise_v2 = np.empty((2, 1))
        errors, variances, roots = np.empty((3, 2, n))
        self._variance_views = errors, variances, roots, *roots
        self._scaled = np.empty(n)
        self._soc = states.mean[SOC]
        self.ocv_slope_v = output.ocv_slope_v

    def update(
        self, step: StepInput, predicted: FloatArray, innovation: FloatArray, innovation_sigma: FloatArray
    ) -> BoolArray | None:
        """Condition the state on one sample of voltages, in place; return (n,) which of them were used, None = all.

        Args:
            step: the sample.
            predicted: (n,) where the predicted voltage goes [V].
            innovation: (n,) likewise measured minus predicted [V].
            innovation_sigma: (n,) likewise its standard deviation [V].
        """
        states, output = self._states, self._output
        Pyy, HPH, HPH_rows = self._term_views
        output.at(step, predicted, Pyy)
        if self._hysteresis_v:
            predicted += self._hysteresis_v * states.hysteresis
        # P_xy = P H,  P_yy = H P H + k q^2
        seen, seen_first, Pxy = self._seen_views
        slopes, H, PH, PH_first, PH_others = self._product_views
        H[...] = slopes
        np.multiply(states.cov, H, PH)
        Pxy[...] = PH_first
        for row in PH_others:
            np.add(Pxy, row, Pxy)
        np.multiply(output.slopes, Pxy, HPH)
        for row in HPH_rows:
            np.add(Pyy, row, Pyy)
        errors, variances, roots, expected_sigma, root = self._variance_views
        self._model_variances(step, errors)
        variances[...] = Pyy
        np.add(variances, errors, variances)
        np.sqrt(variances, roots)
        innovation_sigma[...] = expected_sigma
        np.subtract(step.voltage_v, predicted, innovation)
        accepted = self._gate(step, innovation, expected_sigma)
        # x' = x + P_xy nu / S,  P' = P - P_xy P_xy' / S: with z = P_xy / sqrt(S) it stays symmetric to the last bit
        np.negative(innovation, seen_first)
        gain, gain_column, z, columns, rows = self._gain_views
        np.reciprocal(root, root)
        gain[...] = root
        np.multiply(seen, gain, gain)
        if accepted is not None:
            gain[:, ~accepted] = 0.0
        columns[...] = gain_column
        rows[...] = z
        np.multiply(columns, rows, rows)
        np.subtract(states.gaussian, rows, states.gaussian)
        soc = self._soc
        if soc.item(soc.argmin()) < SOC_MIN or soc.item(soc.argmax()) > SOC_MAX:
            np.maximum(soc, SOC_MIN, out=soc)
            np.minimum(soc, SOC_MAX, out=soc)
        return accepted

    def _model_variances(self, step: StepInput, errors: FloatArray) -> None:
        """Put the variance of the model's error, without and with correlation, into (2, n) [V^2].

        It grows below `empty_soc` and outside the tables.
        """
        tuning, soc, noise_v2 = self._tuning, self._soc, self._noise_v2
        noise_v2[0, 0] = step.noise_v2
        noise_v2[1, 0] = step.noise_v2 * step.correlation
        errors[...] = noise_v2
        is_low = soc.item(soc.argmin()) < tuning.empty_soc
        if is_low or not step.climate.is_inside:
            growth = np.maximum(tuning.empty_soc - soc, 0.0)
            growth *= (tuning.empty_factor - 1.0) / tuning.empty_soc
            growth += 1.0
            growth *= step.climate.noise_scale
            errors *= growth

    def _gate(self, step: StepInput, innovation: FloatArray, sigma: FloatArray) -> BoolArray | None:
        """Return (n,) which samples to use, None = all: inside the gate, or outside it for too long."""
        tuning, refused_s, scaled = self._tuning, self._states.refused_s, self._scaled
        np.divide(innovation, sigma, scaled)
        # argmin and argmax find a NaN first, and no comparison with it holds
        if scaled.item(scaled.argmin()) >= -tuning.gate and scaled.item(scaled.argmax()) <= tuning.gate:
            refused_s.fill(0.0)
            return None
        inside = np.abs(scaled) <= tuning.gate
        missing = np.isnan(innovation)
        refused = ~inside & ~missing
        refused_s[:] = np.where(refused, refused_s + step.dt_s, np.where(missing, refused_s, 0.0))
        believed = refused & (refused_s > tuning.gate_hold_s)
        Pz = self._states.cov[SOC, SOC]
        widened = np.minimum(Pz + tuning.gate_recovery * tuning.gate_recovery * step.dt_s, SOC_VARIANCE_MAX)
        Pz[:] = np.where(believed, np.maximum(widened, Pz), Pz)
        used: BoolArray = inside | believed
        return used
