"""What voltage a state predicts, and how it depends on the state: over sigma points, or along the tangent.

The output is nonlinear in one direction only: that of the SOC at the surface, z_s = g x, g = [1, -rho d_k], which in a
plain circuit is the SOC. With z_s first in the Cholesky factor, only the centre and the two points along its first
column see another z_s; every other pair lies symmetrically on a straight line. So three look-ups give the numbers of
the full set of sigma points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.filters.setup import FilterSetup
from app.estimation.filters.sigma_points import SigmaRule
from app.estimation.filters.tables import OCV, OVERPOTENTIAL, PER_REFERENCE, R0, R1
from tests.oracle.state import VARIANCE_STEP, Measurement, Motion, State


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


def drop(values: FloatArray, motion: Motion, branch_a: FloatArray, over: FloatArray) -> FloatArray:
    """Return (n,) R0 i + e asinh(i / i_ref) + sum R_k i_k [V].

    Args:
        values: (4 + n_rc, n) of `CellTables.circuit`, or their slopes or differences.
        motion: the current.
        branch_a: (n_rc, n) branch currents [A].
        over: (n,) asinh(i / i_ref).
    """
    ohmic = values[R0] * motion.current_a + values[OVERPOTENTIAL] * over
    return np.asarray(ohmic + (values[R1:] * branch_a).sum(axis=0))


def asinh_of(values: FloatArray, motion: Motion) -> FloatArray:
    """Return (n,) asinh(i / i_ref)."""
    return np.arcsinh(motion.current_a * values[PER_REFERENCE])


def surface_direction(setup: FilterSetup, state: State, measured: Measurement) -> FloatArray:
    """Return (1 + n_rc, n) g = [1, -rho d_k], by which the state gives the SOC at the surface."""
    return np.vstack((np.ones_like(state.soc), -state.resistance * setup.cell.surface_at(measured.place)))


def surface_soc(state: State, g: FloatArray) -> FloatArray:
    """Return (n,) z_s = g x."""
    return np.asarray(state.soc + (g[1:] * state.branch_a).sum(axis=0))


def open_loop(setup: FilterSetup, state: State, motion: Motion, values: FloatArray) -> FloatArray:
    """Return (n,) h = OCV - rho drop + M hysteresis [V] for `values` of `CellTables.circuit`."""
    hysteresis_v = setup.cell.model.hysteresis_v * state.hysteresis
    drop_v = drop(values, motion, state.branch_a, asinh_of(values, motion))
    return np.asarray(values[OCV] - state.resistance * drop_v + hysteresis_v)


def output_tangent(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> Output:
    """Return the output along the tangent at the mean.

    D = dOCV/dz_s - rho (dR0/dz_s i + d(e asinh(i / i_ref))/dz_s + sum dR_k/dz_s i_k),   H = D g - [0, rho R_k]
    """
    g = surface_direction(setup, state, measured)
    z_s = surface_soc(state, g)
    here = setup.cell.circuit(z_s, measured.place)
    slope = setup.cell.circuit_slope(z_s, measured.place)
    drop_slope = drop(slope, motion, state.branch_a, asinh_of(here, motion))
    over_a = motion.current_a * here[PER_REFERENCE]
    drop_slope += here[OVERPOTENTIAL] * motion.current_a * slope[PER_REFERENCE] / np.sqrt(1.0 + over_a**2)
    steep = slope[OCV] - state.resistance * drop_slope
    H = steep * g
    H[1:] -= state.resistance * here[R1:]
    return Output(open_loop(setup, state, motion, here), H, np.zeros_like(steep), slope[OCV])


def output_sigma(setup: FilterSetup, rule: SigmaRule, state: State, motion: Motion, measured: Measurement) -> Output:
    """Return the output over the sigma points.

    D = (h+ - h-) / (2 c s),  s = sqrt(g P g)      statistical slope along the first column
    q = h+ + h- - 2 h0,       h = h0 + w q
    H = D g - [0, r]                               r = rho R_k(z_s)

    h+ and h- are counted from h0 and leave out what r makes of the shift p c / s of the currents, p = (P g)_k: what is
    left of (h+ - h-) / (2 c s) is the slope with z_s itself, and no digits are lost where s is small.

    At both points the overpotential of a model of the surface follows its second-order expansion in u = ln(1 / i_ref):
    x = i / i_ref,  d asinh(x) / du = x / sqrt(1 + x^2),  d^2 asinh(x) / du^2 = x / (1 + x^2)^(3/2).
    """
    g = surface_direction(setup, state, measured)
    z_s = surface_soc(state, g)
    here = setup.cell.circuit(z_s, measured.place)
    Pg = np.einsum("uwn,wn->un", state.cov, g)
    variance, shared = np.maximum((g * Pg).sum(axis=0), VARIANCE_STEP), Pg[1:]
    over, x = asinh_of(here, motion), motion.current_a * here[PER_REFERENCE]
    reach, shift = rule.spread * np.sqrt(variance), rule.spread * shared / np.sqrt(variance)

    def beside(side: float) -> tuple[FloatArray, FloatArray]:
        there = setup.cell.circuit(z_s + side * reach, measured.place)
        beyond = there - here
        u = 2.0 * beyond[PER_REFERENCE] / (there[PER_REFERENCE] + here[PER_REFERENCE])  # ln of a ratio, to 3rd order
        over_beyond = u * x / np.sqrt(1.0 + x**2) * (1.0 + u / 2.0 / (1.0 + x**2))
        drop_v = drop(beyond, motion, state.branch_a + side * shift, over) + there[OVERPOTENTIAL] * over_beyond
        return beyond[OCV], beyond[OCV] - state.resistance * drop_v

    right_ocv, right = beside(1.0)
    left_ocv, left = beside(-1.0)
    q = right + left
    H = (right - left) / (2.0 * reach) * g
    H[1:] -= state.resistance * here[R1:]
    return Output(
        h=open_loop(setup, state, motion, here) + rule.weight * q,
        H=H,
        bend_v2=rule.curvature * q**2,
        ocv_slope_v=(right_ocv - left_ocv) / (2.0 * reach),
    )
