"""Where a filter begins: from one sample of voltages, from a SOC that was handed over, or both."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.filters.reference.output import drop
from app.estimation.filters.reference.state import (
    SLOPE_FLOOR_V,
    SOC_MAX,
    SOC_MIN,
    SOC_VARIANCE_MAX,
    Measurement,
    Motion,
    State,
)
from app.estimation.filters.setup import FilterSetup, Kind
from app.estimation.filters.tables import R1

LEAST_VARIANCE: Final = 1e-8  # of a SOC that was handed over


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
    return impose_soc(setup, from_voltage(setup, state, motion, measured), motion, measured, soc, soc_sigma)


def from_voltage(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> State:
    """Return a state that knows the voltage only: SOC without the drop, RC currents half of the current.

    How far the RC pairs have followed the current is unknown, and so is the SOC because of it: both share a covariance.
    A cell that was not measured starts at the mean of the others (at one half if there are none), as unknown as can be.
    """
    cell, tuning, seen = setup.cell, setup.tuning, measured.is_measured
    zeros = np.zeros_like(state.soc)
    branch_a = np.full_like(state.branch_a, motion.current_a / 2.0)
    z = np.where(seen, cell.soc_of_ocv(measured.voltage_v), 0.5)
    for _ in range(3):
        here = cell.circuit(z, measured.place)
        ocv_v = measured.voltage_v + state.resistance * drop(here, motion, branch_a)
        z = np.where(seen, cell.soc_of_ocv(ocv_v), z)
    slope_v = np.maximum(cell.ocv_slope(z), SLOPE_FLOOR_V)
    branch_v2 = (tuning.start_branch_c * cell.model.c_rate_a) ** 2 + (tuning.start_branch_rel * motion.current_a) ** 2
    share = state.resistance * here[R1:] / slope_v
    variance = motion.noise_v2 * measured.cold / slope_v**2 + tuning.start_voltage_sigma**2
    variance = variance + (share**2 * branch_v2).sum(axis=0)
    shrink = np.sqrt(np.minimum(1.0, SOC_VARIANCE_MAX / variance))
    cov = np.zeros_like(state.cov)
    cov[0, 0] = np.where(seen, variance * shrink**2, SOC_VARIANCE_MAX)
    cov[0, 1:] = cov[1:, 0] = np.where(seen, share * branch_v2 * shrink, 0.0)
    rc = np.arange(1, 1 + cell.n_rc)
    cov[rc, rc] = branch_v2
    z = np.clip(np.where(seen, z, z[seen].mean() if seen.any() else 0.5), SOC_MIN, SOC_MAX)
    return State(
        soc=z,
        branch_a=branch_a,
        cov=cov,
        hysteresis=zeros,
        temperature_degc=state.temperature_degc,
        capacity_ah=state.capacity_ah,
        resistance=state.resistance,
        refused_s=zeros,
        count_soc=z,
        count_gain=zeros,
        count_offset=zeros,
        anchor_v2=cov[0, 0].copy(),
        doubt_s=zeros,
        apart=zeros,
        wander_v2=zeros,
        check_mean_v=zeros,
        check_square_v2=zeros,
        slow_mean_v=zeros,
        slow_square_v2=np.full_like(z, tuning.bias_start_v**2),
    )


def impose_soc(
    setup: FilterSetup, state: State, motion: Motion, measured: Measurement, soc: FloatArray, soc_sigma: FloatArray
) -> State:
    """Return the state with the count begun at a given SOC; a filter that is not fused begins there too."""
    given = ~np.isnan(soc)
    default = initial_sigma(setup, state, motion, measured, soc)
    sigma = np.where(np.isnan(soc_sigma), default if setup.counts else setup.tuning.start_soc_sigma, soc_sigma)
    count_soc = np.where(given, np.clip(soc, SOC_MIN, SOC_MAX), state.soc)
    anchor_v2 = np.where(given, np.clip(sigma**2, LEAST_VARIANCE, SOC_VARIANCE_MAX), state.cov[0, 0])
    state = replace(state, count_soc=count_soc, anchor_v2=anchor_v2, apart=state.soc - count_soc)
    if setup.kind is Kind.SIGMA_FUSED:
        return state
    cov = state.cov.copy()
    cov[0, 1:] = cov[1:, 0] = np.where(given, 0.0, cov[0, 1:])
    cov[0, 0] = anchor_v2
    return replace(state, soc=count_soc, cov=cov)


def initial_sigma(
    setup: FilterSetup, state: State, motion: Motion, measured: Measurement, soc: FloatArray
) -> FloatArray:
    """Return (n,) sigma of an initial SOC that came without one: at rest, how far the voltage says that it is off."""
    tuning, cell = setup.tuning, setup.cell
    off, off_v = np.abs(state.soc - soc), np.abs(cell.ocv(state.soc) - cell.ocv(soc))
    at_rest = measured.is_measured & (abs(motion.current_a) < tuning.rest_c * cell.model.c_rate_a)
    is_off = at_rest & (off_v > tuning.rest_error_v) & (off < tuning.rest_off_max)
    return np.where(is_off, off, tuning.counter_soc_sigma)
