"""Where a filter begins: from one sample of voltages, from a SOC that was handed over, or both."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.filters.setup import FilterSetup, Kind
from app.estimation.filters.tables import R1
from tests.oracle.output import open_loop, surface_direction, surface_soc
from tests.oracle.state import (
    LEAST_VARIANCE,
    N_STARTS,
    SOC_MAX,
    SOC_MIN,
    SOC_VARIANCE_MAX,
    Measurement,
    Motion,
    State,
    lasting_v2,
    noise_v2,
)

START_POINTS: Final = 101  # points of the SOC among which the first voltage chooses


def start(
    setup: FilterSetup, state: State, motion: Motion, measured: Measurement, soc: FloatArray, soc_sigma: FloatArray
) -> State:
    """Return the state after the first sample.

    Args:
        setup: the filter.
        state: as it was; temperatures, capacities and resistances stay.
        motion: a step of no length at the sample's current.
        measured: the sample.
        soc: (n,) initial SOC, NaN = unknown.
        soc_sigma: (n,) its sigma, NaN = unknown.
    """
    return impose_soc(setup, from_voltage(setup, state, motion, measured), soc, soc_sigma)


def from_voltage(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> State:
    """Return a state that knows the voltage only: SOC as the voltage makes it likely.

    A fast RC pair has followed half of the current, a slow one what flowed before, in a drive far less:

        i_k = start_branch_rel i / (1 + tau_k / start_branch_s)

    How far is unknown, and so is the SOC because of it: both share a covariance, as over a line of slope s / sigma. A
    cell that was not measured starts at the mean of the others (at one half if there are none), as unknown as can be.
    """
    cell, tuning, seen = setup.cell, setup.tuning, measured.is_measured
    zeros = np.zeros_like(state.soc)
    tau_s = cell.time_constants(np.full_like(zeros, 0.5), measured.place)
    branch_a = tuning.start_branch_rel * motion.current_a / (1.0 + tau_s / tuning.start_branch_s)
    branch_a[-1] = 0.0
    state = replace(state, branch_a=branch_a, hysteresis=zeros)
    z, variance = likely_soc(setup, state, motion, measured)
    z, variance = np.where(seen, z, 0.5), np.where(seen, variance + tuning.start_voltage_sigma**2, SOC_VARIANCE_MAX)
    voltage_v2, ohm, branch_v2 = start_voltage_v2(setup, replace(state, soc=z), motion, measured)
    cov = np.zeros_like(state.cov)
    cov[0, 0] = np.minimum(variance, SOC_VARIANCE_MAX)
    cov[0, 1:] = cov[1:, 0] = np.where(seen, ohm * branch_v2 * np.sqrt(cov[0, 0] / voltage_v2), 0.0)
    rc = np.arange(1, 1 + cell.n_rc)
    cov[rc, rc] = branch_v2
    z = np.clip(np.where(seen, z, z[seen].mean() if seen.any() else 0.5), SOC_MIN, SOC_MAX)
    return State(
        soc=z,
        branch_a=branch_a,
        cov=cov,
        gain=zeros,
        gain_v2=np.full_like(z, tuning.gain_sigma**2),
        gain_step=zeros,
        gain_slope=np.zeros_like(state.gain_slope),
        hysteresis=zeros,
        temperature_degc=state.temperature_degc,
        capacity_ah=state.capacity_ah,
        resistance=state.resistance,
        refused_s=zeros,
        count_soc=z,
        count_gain=zeros,
        count_offset=zeros,
        anchor_v2=cov[0, 0].copy(),
        rest_mean_v=np.where(seen, measured.voltage_v, 0.0),
        rest_moment=zeros,
        unsettled_v2=zeros,
        drawn=zeros,
        start_soc=np.tile(z, (N_STARTS, 1)),
        start_v2=np.full((N_STARTS, z.size), SOC_VARIANCE_MAX),
        start_weight=np.zeros((N_STARTS, z.size)),
        best_soc=z,
        best_v2=np.full_like(z, SOC_VARIANCE_MAX),
        best_drawn=zeros,
        best_offset=zeros,
        fused_soc=z,
        fused_v2=cov[0, 0].copy(),
        fused_gain=zeros,
        conflict=zeros,
        apart=zeros,
        apart_v2=cov[0, 0].copy(),
        wander_v2=zeros,
        check_mean_v=zeros,
        check_square_v2=zeros,
        slow_mean_v=zeros,
        slow_square_v2=np.full_like(z, tuning.lasting_v**2),
    )


def likely_soc(
    setup: FilterSetup, state: State, motion: Motion, measured: Measurement
) -> tuple[FloatArray, FloatArray]:
    """Return (n,) mean and variance of the SOC over all SOC, each as likely as it makes the voltage.

    p(z) ~ exp(-(v - h(z))^2 / 2 s^2) / s,   s^2 of `start_voltage_v2`

    In a plateau that is its middle, as unsure as it is wide.
    """
    found = []
    for z in np.linspace(0.0, 1.0, START_POINTS):
        at = replace(state, soc=np.full_like(state.soc, z))
        voltage_v2, _, _ = start_voltage_v2(setup, at, motion, measured)
        z_s = surface_soc(at, surface_direction(setup, at, measured))
        off_v = measured.voltage_v - open_loop(setup, at, motion, setup.cell.circuit(z_s, measured.place))
        found.append((at.soc, -(off_v**2) / voltage_v2 / 2.0, 1.0 / np.sqrt(voltage_v2)))
    soc, exponent, height = np.moveaxis(np.array(found), 1, 0)
    weight = height * np.exp(exponent - exponent.max(axis=0))
    weight /= weight.sum(axis=0)
    mean = (weight * soc).sum(axis=0)
    return mean, (weight * (soc - mean) ** 2).sum(axis=0)


def start_voltage_v2(
    setup: FilterSetup, state: State, motion: Motion, measured: Measurement
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s^2 = r + sum ohm_k^2 P_kk (n,) of the voltage at a SOC [V^2], and (n_rc, n) ohm_k and P_kk.

    ohm_k = rho (R_k + d_k dOCV/dz_s)
    """
    tuning, cell = setup.tuning, setup.cell
    g = surface_direction(setup, state, measured)
    z_s = surface_soc(state, g)
    ohm = state.resistance * cell.circuit(z_s, measured.place)[R1:] - g[1:] * cell.ocv_slope(z_s)
    pair_v2 = (tuning.driven_c * cell.model.c_rate_a) ** 2 + (tuning.start_branch_rel * motion.current_a) ** 2
    branch_v2 = np.full_like(ohm, pair_v2)
    branch_v2[-1] = lasting_v2(setup, state, motion, measured)
    return noise_v2(setup, motion, measured) + (ohm**2 * branch_v2).sum(axis=0), ohm, branch_v2


def impose_soc(setup: FilterSetup, state: State, soc: FloatArray, soc_sigma: FloatArray) -> State:
    """Return the state with the count begun at a given SOC; a filter that is not fused begins there too."""
    given, tuning = ~np.isnan(soc), setup.tuning
    default = tuning.counter_soc_sigma if setup.counts else tuning.start_soc_sigma
    sigma = np.where(np.isnan(soc_sigma), default, soc_sigma)
    state = suppose(setup, state, soc, soc_sigma)
    count_soc = np.where(given, np.clip(soc, SOC_MIN, SOC_MAX), state.soc)
    anchor_v2 = np.where(given, np.clip(sigma**2, LEAST_VARIANCE, SOC_VARIANCE_MAX), state.cov[0, 0])
    state = replace(state, count_soc=count_soc, anchor_v2=anchor_v2, apart=state.soc - count_soc)
    if setup.kind is Kind.SIGMA_FUSED:
        return state
    cov = state.cov.copy()
    cov[0, 1:] = cov[1:, 0] = np.where(given, 0.0, cov[0, 1:])
    cov[0, 0] = anchor_v2
    return replace(state, soc=count_soc, cov=cov)


def suppose(setup: FilterSetup, state: State, soc: FloatArray, soc_sigma: FloatArray) -> State:
    """Return the state with the hypotheses of a SOC that was given.

    It is right as exactly as was said, or roughly, or says nothing.
    """
    tuning, given = setup.tuning, ~np.isnan(soc)
    exact = np.where(np.isnan(soc_sigma), tuning.counter_soc_sigma, soc_sigma)
    one = np.ones_like(exact)
    spread = np.array([exact, np.maximum(tuning.rough_soc, 3.0 * exact), one, one])
    weight = np.array([[tuning.start_exact], [tuning.start_rough], [0.0], [0.0]])
    return replace(
        state,
        start_soc=np.where(given, np.clip(soc, SOC_MIN, SOC_MAX), state.start_soc),
        start_v2=np.clip(spread**2, LEAST_VARIANCE, SOC_VARIANCE_MAX),
        start_weight=np.where(given, weight, 0.0),
    )
