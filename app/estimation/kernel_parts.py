"""What the compiled kernels share: how they are compiled, the scalars they read, the small formulas of a step.

The equations and their names are those of `marginal`; tests pin both to each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numba

from app.estimation.process import SOC_VARIANCE_MAX, VARIANCE_STEP
from app.estimation.tables import N_SOC, SOC_LOW, SOC_STEP

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg"
# ruff: noqa: ANN001, ANN201

OUT_SOC, OUT_SIGMA, OUT_OCV, OUT_VOLTAGE, OUT_INNOVATION, OUT_INNOVATION_SIGMA = range(6)
N_OUT = 6  # numbers of `Estimates`, in its order; the flags follow
FLAG_VALID, FLAG_ACCEPTED = range(2)
N_FLAGS = 2


class Numbers(NamedTuple):
    """Every scalar the kernels read: rule, cell and tuning, with the names and units they have there."""

    is_sigma: float
    is_fused: float
    spread: float
    weight: float
    curvature: float
    unknown_odds: float
    capacity_coulomb: float
    capacity_ah: float
    efficiency: float
    i_ref: float
    hysteresis_v: float
    hysteresis_rate: float
    empty_slope: float
    empty_soc: float
    model_error_v: float
    model_error_per_a_v: float
    correlation_s: float
    bias_v: float
    bias_s: float
    cold_factor: float
    soc_walk: float
    branch_rel: float
    branch_c: float
    gate: float
    gate_hold_s: float
    gate_recovery: float
    counter_gain: float
    counter_offset_c: float
    anchor_s: float
    check_s: float
    check_rms_v: float
    check_bias_v: float


N_NUMBERS = len(Numbers._fields)


def jit(function: Callable[..., Any]) -> Any:
    """Compile on first call, and keep the result on disk where the installation allows it."""
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # no place to write a cache to
        return numba.njit(error_model="numpy")(function)


def inline(function: Callable[..., Any]) -> Any:
    """Compile into the callers, for what takes scalars: a call would hand them over one by one.

    What takes arrays is left to the compiler, which then sees that no reference has to be counted.
    """
    return numba.njit(error_model="numpy", inline="always")(function)


@inline
def place_soc(soc):
    """Return the grid index and the weight of the next point; held at the ends of the tables."""
    x = min(max((soc - SOC_LOW) * (1.0 / SOC_STEP), 0.0), N_SOC - 1.0)
    j = int(x)
    return j, x - j


@inline
def blend(value, by_soc, by_temperature, by_both, f, g):
    """Bilinear value from the four coefficients of a table row."""
    return (value + f * by_soc) + g * (by_temperature + f * by_both)


@inline
def noise(p, soc, outside_k, noise_v2):
    """Return the variance of the model's error at this SOC and temperature."""
    scale = (1.0 + p.cold_factor * outside_k / 10.0) ** 2
    low = max(p.empty_soc - soc, 0.0) * p.empty_slope + 1.0
    return low * scale * noise_v2


@inline
def gate(p, innovation, expected, refused_s, dt):
    """Return whether to use the sample, whether only because it has been refused for too long, and for how long."""
    if not math.isfinite(innovation):
        return False, False, refused_s
    if innovation * innovation <= p.gate * p.gate * expected:
        return True, False, 0.0
    refused_s += dt
    believed = refused_s > p.gate_hold_s
    return believed, believed, refused_s


@inline
def widened(p, variance, dt):
    """Return the variance of a SOC whose samples were refused for too long."""
    return max(min(variance + p.gate_recovery * p.gate_recovery * dt, SOC_VARIANCE_MAX), variance)


@inline
def common(p, dt, i):
    """Return what one step has in common for all cells."""
    kept = p.efficiency if i < 0.0 else 1.0
    moved = kept * i * dt / p.capacity_coulomb
    walk = min(p.soc_walk**2 * dt, SOC_VARIANCE_MAX) + VARIANCE_STEP
    keep = math.sqrt(max(1.0 - walk / SOC_VARIANCE_MAX, 0.0))
    branch_variance = (p.branch_rel * i) ** 2 + (p.branch_c * p.capacity_ah) ** 2
    noise_v2 = p.model_error_v**2 + (p.model_error_per_a_v * i) ** 2
    correlation = 1.0 + 2.0 * p.correlation_s / max(dt, 1e-3)
    check = p.model_error_v / math.sqrt(noise_v2), 1.0 - math.exp(-dt / p.check_s), 1.0 - math.exp(-dt / p.bias_s)
    return moved, walk, keep, branch_variance, noise_v2, correlation, math.asinh(i / p.i_ref), check
