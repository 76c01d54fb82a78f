"""The update: condition the state on one sample of voltages."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.filters.setup import FilterSetup
from app.estimation.filters.tables import COLD, DROP_ERROR
from tests.oracle.output import Output
from tests.oracle.state import (
    SOC_MAX,
    SOC_MIN,
    SOC_VARIANCE_MAX,
    Measurement,
    Motion,
    State,
    empty_growth,
    noise_v2,
)


@dataclass(frozen=True)
class Innovation:
    """What n voltages said.

    Attributes:
        nu: (n,) measured minus predicted [V]; NaN where not measured.
        sigma: (n,) expected of it, without the correlation of the model's error [V].
        used: (n,) whether the state was conditioned on it.
    """

    nu: FloatArray
    sigma: FloatArray
    used: BoolArray


def update(
    setup: FilterSetup, state: State, motion: Motion, measured: Measurement, output: Output
) -> tuple[State, Innovation]:
    """Return the state conditioned on the voltages, and the innovations.

    P_xy = P H,   P_yy = H P H + k q^2,   S = P_yy + R
    x' = x + P_xy nu / S,   P' = P - P_xy P_xy' / S

    P' cannot lose definiteness: S - P_xy' P^-1 P_xy = R + k q^2 > 0, and R is never below the model's own variance.
    """
    Pxy = np.einsum("uwn,wn->un", state.cov, output.H)
    Pyy = (output.H * Pxy).sum(axis=0) + output.bend_v2
    # the model's error grows near empty and where nothing was measured
    error_v2 = noise_v2(setup, motion, measured) * empty_growth(setup, state, measured) ** 2
    nu = measured.voltage_v - output.h
    sigma = np.sqrt(Pyy + error_v2)
    state, used = gate(setup, state, motion, nu, sigma)
    S = Pyy + error_v2 * motion.correlation
    gain = np.where(used, Pxy / S, 0.0)
    wander_v2 = motion.correlation * (output.H[0] ** 2 * state.wander_v2 + state.slow_square_v2)
    S_g = measured.uncertainty[COLD] ** 2 * (S + wander_v2)
    innovation = Innovation(nu, sigma, used)
    learns = used & (measured.uncertainty[DROP_ERROR] < setup.tuning.drop_error_max)
    state = learn_gain(state, learns, output.H, nu, gain, S_g, motion.is_beyond)
    moved = gain * np.where(used, nu, 0.0)
    after = replace(
        state,
        soc=np.clip(state.soc + moved[0], SOC_MIN, SOC_MAX),
        branch_a=state.branch_a + moved[1:],
        cov=state.cov - gain[:, None] * gain * S,
    )
    return after, innovation


def learn_gain(
    state: State,
    learns: BoolArray,
    H: FloatArray,
    nu: FloatArray,
    gain: FloatArray,
    S: FloatArray,
    is_beyond: bool,
) -> State:
    """Return the state with what the innovations say of the gain g of the charge.

    It stands beside the filter, which goes on as if there were none (Friedland 1969): with it the mean would be x + V g
    and the innovation nu - H V g.

    g' = g + M H V (nu - H V g) / (S_g + (H V)^2 M),   M' = M S_g / (S_g + (H V)^2 M),   V' = V - K H V
    S_g = cold^2 (S + correlation (H_z^2 wander + slow))

    A filter that wanders against the count, or whose innovations do not average out, says the less of charge, and so
    does a cold cell, whose slow overpotential looks like charge. Beyond the currents that the cell file has seen the
    model errs as charge would, and alike for all cells: what they differ by counts, their mean does not. Each of n
    cells moves by what its sample says less the mean of the sample before, M by a share 1 - 1/n.

    Args:
        state: before the update.
        learns: (n,) whether the sample counts: it is used, and the cell file has seen such temperatures.
        H: (1 + n_rc, n) slopes of the output.
        nu: (n,) innovations [V].
        gain: (1 + n_rc, n) K of the filter, 0 where the innovation is not used.
        S: (n,) S_g, variance of the innovation with correlation and the errors that the filter has shown [V^2].
        is_beyond: whether the cell file has not seen such currents.
    """
    own_share = 1.0 - 1.0 / nu.size if is_beyond else 1.0
    learns = learns & (own_share > 0.0)
    before = state.gain_step[~np.isnan(state.gain_step)]
    shared = before.mean() if is_beyond and before.size else 0.0
    HV, M = (H * state.gain_slope).sum(axis=0), state.gain_v2
    off_v = np.where(learns, nu - HV * state.gain, 0.0)
    total = S + HV**2 * M
    said = M * HV * off_v / total
    return replace(
        state,
        gain=state.gain + np.where(learns, said - shared, 0.0),
        gain_v2=np.where(learns, M + own_share * (M * S / total - M), M),
        gain_step=np.where(learns, said, np.nan),
        gain_slope=state.gain_slope - gain * HV,
    )


def gate(
    setup: FilterSetup, state: State, motion: Motion, nu: FloatArray, sigma: FloatArray
) -> tuple[State, BoolArray]:
    """Return (n,) which innovations to use: inside the gate, or outside it for longer than `gate_hold_s`.

    Where one is believed though it lies outside, the SOC's variance grows first.
    """
    tuning = setup.tuning
    inside, missing = np.abs(nu) <= tuning.gate * sigma, np.isnan(nu)
    refused_s = np.where(inside, 0.0, np.where(missing, state.refused_s, state.refused_s + motion.dt_s))
    believed = ~inside & ~missing & (refused_s > tuning.gate_hold_s)
    variance = state.cov[0, 0]
    widened = np.minimum(variance + tuning.gate_recovery**2 * motion.dt_s, SOC_VARIANCE_MAX)
    cov = state.cov.copy()
    cov[0, 0] = np.where(believed, np.maximum(widened, variance), variance)
    return replace(state, cov=cov, refused_s=refused_s), inside | believed
