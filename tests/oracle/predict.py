"""What happens to a state between two samples: everything that moves is linear."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from app.estimation.filters.setup import FilterSetup
from tests.oracle.state import (
    SOC_VARIANCE_MAX,
    VARIANCE_STEP,
    Measurement,
    Motion,
    State,
    lasting_v2,
)


def predict(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> State:
    """Return the state moved over one step of held current.

    z'   = z - m,   m = eta i dt / capacity          the count likewise
    i_k' = a_k i_k + (1 - a_k) i,   a_k = exp(-dt / tau_k)
    P'   = A P A + Q,   A = diag(keep, a_1 ..)       keep^2 P_zz + walk stays below its maximum
    V_z' = V_z - m,   V_k' = a_k V_k                 a gain g of the charge would make it x + V g
    h'   = f h - sign(m) (1 - f),   f = exp(-rate |m|)

    Args:
        setup: the filter.
        state: before the step.
        motion: the step.
        measured: places of the temperatures.
    """
    cell, tuning = setup.cell, setup.tuning
    i, dt = motion.current_a, motion.dt_s
    moved = motion.moved_ah / state.capacity_ah
    a = np.exp(-dt / cell.time_constants(state.soc, measured.place))
    branch_v2 = (tuning.branch_rel * i) ** 2
    walk = min(tuning.soc_walk**2 * dt, SOC_VARIANCE_MAX) + VARIANCE_STEP
    keep = math.sqrt(max(1.0 - walk / SOC_VARIANCE_MAX, 0.0))
    A = np.vstack((np.full_like(state.soc, keep), a))
    steady_v2 = np.full_like(a, branch_v2)
    steady_v2[-1] = lasting_v2(setup, state, motion, measured)
    least_v2 = np.full((cell.n_rc, 1), VARIANCE_STEP * cell.model.c_rate_a**2)
    least_v2[-1] = VARIANCE_STEP
    Q = np.vstack((np.full_like(state.soc, walk), (1.0 - a**2) * steady_v2 + least_v2))
    driven = np.full((cell.n_rc, 1), i)
    driven[-1] = 0.0  # nothing drives the lasting error
    cov = (A[:, None] * A) * state.cov
    diagonal = np.arange(1 + cell.n_rc)
    cov[diagonal, diagonal] += Q
    model_moved = motion.moved_ah / cell.model.capacity_ah
    follow = math.exp(-cell.model.hysteresis_rate * abs(model_moved)) if cell.model.hysteresis_v else 1.0
    return replace(
        state,
        soc=state.soc - moved,
        gain_slope=np.vstack(((state.gain_slope[0] - moved)[None], a * state.gain_slope[1:])),
        fused_soc=state.fused_soc - moved * (1.0 + state.fused_gain),
        drawn=state.drawn + moved,
        branch_a=a * state.branch_a + (1.0 - a) * driven,
        cov=cov,
        hysteresis=follow * state.hysteresis - math.copysign(1.0 - follow, model_moved),
        count_soc=state.count_soc - moved,
        count_gain=state.count_gain + tuning.counter_gain * moved,
        count_offset=state.count_offset + tuning.counter_offset_c * dt / 3600.0,
    )
