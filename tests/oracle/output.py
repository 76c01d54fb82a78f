"""What voltage a state predicts, and how it depends on the state: over sigma points, or along the tangent.

The output is nonlinear in SOC only. With SOC first in the Cholesky factor, only the centre and the two points along its
first column see another SOC; every other pair lies symmetrically on a straight line. So three look-ups give the numbers
of the full set of sigma points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.filters.setup import FilterSetup
from app.estimation.filters.sigma_points import SigmaRule
from app.estimation.filters.tables import OCV, OVERPOTENTIAL, R0, R1
from tests.oracle.state import Measurement, Motion, State


@dataclass(frozen=True)
class Output:
    """Predicted voltage of n cells.

    Attributes:
        h: (n,) mean [V].
        H: (1 + n_rc, n) slopes with the state.
        bend_v2: (n,) k q^2, what curvature adds to its variance [V^2].
        ocv_slope_v: (n,) the OCV's share of H[0] [V].
    """

    h: FloatArray
    H: FloatArray
    bend_v2: FloatArray
    ocv_slope_v: FloatArray


def drop(values: FloatArray, motion: Motion, branch_a: FloatArray) -> FloatArray:
    """Return (n,) R0 i + e asinh(i / i_ref) + sum R_k i_k [V].

    Args:
        values: (3 + n_rc, n) of `CellTables.circuit`, or their slopes or differences.
        motion: the current.
        branch_a: (n_rc, n) RC currents [A].
    """
    ohmic = values[R0] * motion.current_a + values[OVERPOTENTIAL] * motion.over
    return np.asarray(ohmic + (values[R1:] * branch_a).sum(axis=0))


def open_loop(setup: FilterSetup, state: State, motion: Motion, values: FloatArray) -> FloatArray:
    """Return (n,) h = OCV - rho drop + M hysteresis [V] for `values` of `CellTables.circuit`."""
    hysteresis_v = setup.cell.model.hysteresis_v * state.hysteresis
    return np.asarray(values[OCV] - state.resistance * drop(values, motion, state.branch_a) + hysteresis_v)


def output_tangent(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> Output:
    """Return the output along the tangent at the mean.

    H_z = dOCV/dz - rho (dR0/dz i + de/dz asinh(i / i_ref) + sum dR_k/dz i_k),   H_k = -rho R_k
    """
    here = setup.cell.circuit(state.soc, measured.place)
    slope = setup.cell.circuit_slope(state.soc, measured.place)
    steep = slope[OCV] - state.resistance * drop(slope, motion, state.branch_a)
    H = np.vstack((steep, -state.resistance * here[R1:]))
    return Output(open_loop(setup, state, motion, here), H, np.zeros_like(steep), slope[OCV])


def output_sigma(setup: FilterSetup, rule: SigmaRule, state: State, motion: Motion, measured: Measurement) -> Output:
    """Return the output over the sigma points.

    D = (h+ - h-) / (2 c s),  s = sqrt(P_zz)       statistical slope along the first column
    q = h+ + h- - 2 h0,       h = h0 + w q
    H = [D + p r / P_zz, -r]                       r = rho R_k(z),  p = P_zi

    h+ and h- are counted from h0 and leave out what r makes of the shift p c / s of the currents: what is left of
    (h+ - h-) / (2 c s) is H_z itself, and no digits are lost where s is small.
    """
    here = setup.cell.circuit(state.soc, measured.place)
    variance, shared = state.cov[0, 0], state.cov[1:, 0]
    reach, shift = rule.spread * np.sqrt(variance), rule.spread * shared / np.sqrt(variance)

    def beside(side: float) -> tuple[FloatArray, FloatArray]:
        beyond = setup.cell.circuit(state.soc + side * reach, measured.place) - here
        return beyond[OCV], beyond[OCV] - state.resistance * drop(beyond, motion, state.branch_a + side * shift)

    right_ocv, right = beside(1.0)
    left_ocv, left = beside(-1.0)
    q = right + left
    return Output(
        h=open_loop(setup, state, motion, here) + rule.weight * q,
        H=np.vstack(((right - left) / (2.0 * reach), -state.resistance * here[R1:])),
        bend_v2=rule.curvature * q**2,
        ocv_slope_v=(right_ocv - left_ocv) / (2.0 * reach),
    )
