"""The step of a filter, cell by cell, compiled by numba; needs the extra `voltwall[fast]`.

The equations and their names are those of `marginal`, `fusion` and `self_check`; tests pin both to each other.
`advance_pair` writes the algebra of two RC pairs out in scalars that stay in registers, which is what almost every
cell file holds; `advance_any` loops over 0 to 4 pairs. Both read and write the block of `CellStates`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from app.estimation.circuit import SECONDS_PER_HOUR
from app.estimation.inputs import TEMPERATURE_MAX_DEGC, VOLTAGE_MAX_V, VOLTAGE_MIN_V
from app.estimation.marginal import SOC_MAX, SOC_MIN, SOC_VARIANCE_MAX, VARIANCE_STEP
from app.estimation.start import SLOPE_FLOOR_V
from app.estimation.states import (
    ANCHOR_V2,
    CHECK_MEAN,
    CHECK_SQUARE,
    COUNT,
    COUNT_GAIN,
    COUNT_OFFSET,
    DOUBT,
    HYSTERESIS,
    REFUSED,
    TEMPERATURE,
)
from app.estimation.tables import N_SOC, SOC_LOW, SOC_STEP

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg"
# ruff: noqa: ANN001, ANN201, ANN202

OUT_SOC, OUT_SIGMA, OUT_OCV, OUT_VOLTAGE, OUT_INNOVATION, OUT_INNOVATION_SIGMA, OUT_VALID, OUT_ACCEPTED = range(8)
N_OUT = 8


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
    model_error_per_c_v: float
    correlation_s: float
    bias_v: float
    bias_share: float
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


def _jit(function: Callable[..., Any]) -> Any:
    """Compile on first call, and keep the result on disk where the installation allows it."""
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # no place to write a cache to
        return numba.njit(error_model="numpy")(function)


def _inline(function: Callable[..., Any]) -> Any:
    """Compile into the callers: a call would hand over every scalar one by one."""
    return numba.njit(error_model="numpy", inline="always")(function)


@_inline
def _place_soc(soc):
    x = min(max((soc - SOC_LOW) * (1.0 / SOC_STEP), 0.0), N_SOC - 1.0)
    j = int(x)
    return j, x - j


@_inline
def _place_temperature(grid, t):
    """Return table row and weight of the next row."""
    n = grid.size
    if n == 1:
        return 0, 0.0
    j = 0
    while j < n - 2 and t >= grid[j + 1]:
        j += 1
    return j, min(max((t - grid[j]) / (grid[j + 1] - grid[j]), 0.0), 1.0)


@_inline
def _corner(circuit, at, k, f, g):
    """Bilinear value of table k; a row of `circuit` is (4, n_tables): value, difference in SOC, temperature, both."""
    return (circuit[at, 0, k] + f * circuit[at, 1, k]) + g * (circuit[at, 2, k] + f * circuit[at, 3, k])


@_inline
def _corner_slope(circuit, at, k, g):
    return (circuit[at, 1, k] + g * circuit[at, 3, k]) * (1.0 / SOC_STEP)


@_inline
def _noise(p, soc, outside_k, noise_v2):
    """Return the variance of the model's error at this SOC and temperature."""
    scale = (1.0 + p.cold_factor * outside_k / 10.0) ** 2
    low = max(p.empty_soc - soc, 0.0) * p.empty_slope + 1.0
    return low * scale * noise_v2


@_inline
def _gate(p, innovation, expected, refused_s, dt):
    """Return whether to use the sample, whether only because it has been refused for too long, and for how long."""
    if not math.isfinite(innovation):
        return False, False, refused_s
    if innovation * innovation <= p.gate * p.gate * expected:
        return True, False, 0.0
    refused_s += dt
    believed = refused_s > p.gate_hold_s
    return believed, believed, refused_s


@_inline
def _widened(p, variance, dt):
    return max(min(variance + p.gate_recovery * p.gate_recovery * dt, SOC_VARIANCE_MAX), variance)


@_inline
def _fuse(p, count, count_v2, soc, variance):
    """Return fused SOC, variance, and the probability that the start was right."""
    total = count_v2 + variance
    apart = soc - count
    tail = apart * apart / total * (1.0 / 32.0) + 1.0
    tail *= tail
    tail *= tail
    tail *= tail
    tail *= tail
    w = 1.0 / (tail * math.sqrt(total) * p.unknown_odds + 1.0)
    share = variance / total
    wg = w * share
    return soc - wg * apart, variance - wg * (variance - (1.0 - w) * (share * (apart * apart))), w


@_inline
def _report(
    p, block, slow, cell, dt, moved, soc, variance, slope, check_scale, check_weight, innovation, used, ocv, out
):
    """Sigma, fusion and self-check of one cell after its update, and the part of its result that follows."""
    square = block[slow + CHECK_SQUARE, cell]
    bias_v2 = p.bias_v * p.bias_v + p.bias_share * square
    variance = min(variance + bias_v2 / max(slope * slope, SLOPE_FLOOR_V * SLOPE_FLOOR_V), SOC_VARIANCE_MAX)
    if p.is_fused != 0.0:
        count = block[slow + COUNT, cell] - moved
        gain = block[slow + COUNT_GAIN, cell] + p.counter_gain * moved
        offset = block[slow + COUNT_OFFSET, cell] + (p.counter_offset_c / SECONDS_PER_HOUR) * dt
        filter_soc, filter_v2 = soc, variance
        count_v2 = gain * gain + offset * offset + block[slow + ANCHOR_V2, cell]
        soc, variance, w = _fuse(p, count, count_v2, soc, variance)
        doubt = block[slow + DOUBT, cell] + dt if w < 0.5 else 0.0
        if doubt > p.anchor_s:
            count, gain, offset, doubt = filter_soc, 0.0, 0.0, 0.0
            block[slow + ANCHOR_V2, cell] = filter_v2
        block[slow + COUNT, cell], block[slow + DOUBT, cell] = count, doubt
        block[slow + COUNT_GAIN, cell], block[slow + COUNT_OFFSET, cell] = gain, offset
    mean = block[slow + CHECK_MEAN, cell]
    if used:
        scaled = innovation * check_scale
        mean += check_weight * (scaled - mean)
        square += check_weight * (scaled * scaled - square)
        block[slow + CHECK_MEAN, cell], block[slow + CHECK_SQUARE, cell] = mean, square
    valid = square < p.check_rms_v * p.check_rms_v and abs(mean) < p.check_bias_v
    j, f = _place_soc(soc)
    out[OUT_SOC, cell] = min(max(soc, 0.0), 1.0)
    out[OUT_SIGMA, cell] = math.sqrt(variance)
    out[OUT_OCV, cell] = ocv[j, 0] + f * ocv[j, 1]
    out[OUT_INNOVATION, cell] = innovation
    out[OUT_VALID, cell] = 1.0 if valid else 0.0


@_inline
def _common(p, dt, i):
    """Return what one step has in common for all cells."""
    kept = p.efficiency if i < 0.0 else 1.0
    moved = kept * i * dt / p.capacity_coulomb
    walk = min(p.soc_walk**2 * dt, SOC_VARIANCE_MAX) + VARIANCE_STEP
    keep = math.sqrt(max(1.0 - walk / SOC_VARIANCE_MAX, 0.0))
    branch_variance = (p.branch_rel * i) ** 2 + (p.branch_c * p.capacity_ah) ** 2
    noise_v2 = p.model_error_v**2 + (p.model_error_per_c_v * (i / p.capacity_ah)) ** 2
    correlation = 1.0 + 2.0 * p.correlation_s / max(dt, 1e-3)
    check_scale, check_weight = p.model_error_v / math.sqrt(noise_v2), 1.0 - math.exp(-dt / p.check_s)
    return moved, walk, keep, branch_variance, noise_v2, correlation, math.asinh(i / p.i_ref), check_scale, check_weight


@_inline
def _point_pair(ocv, circuit, soc, row, g, i, over, i1, i2):
    """Return output without hysteresis, R_1 and R_2 at one sigma point."""
    j, f = _place_soc(soc)
    at = j + N_SOC * row
    r1, r2 = _corner(circuit, at, 1, f, g), _corner(circuit, at, 2, f, g)
    drop = i * _corner(circuit, at, 0, f, g) + r1 * i1 + r2 * i2
    if circuit.shape[2] > 3:
        drop += over * _corner(circuit, at, 3, f, g)
    return ocv[j, 0] + f * ocv[j, 1] - drop, r1, r2


@_jit
def advance_pair(block, ocv, circuit, tau, grid, numbers, dt, i, voltage_v, temperature_degc, out):
    """Advance all cells of a two-RC model with fixed time constants by one sample, with sigma points."""
    p = Numbers(*to_fixed_tuple(numbers, N_NUMBERS))
    moved, walk, keep, branch_variance, noise_v2, correlation, over, check_scale, check_weight = _common(p, dt, i)
    follow = math.exp(-p.hysteresis_rate * abs(moved))
    pull = math.copysign(1.0 - follow, moved)
    a1, a2 = math.exp(-dt / tau[0, 0, 0]), math.exp(-dt / tau[1, 0, 0])
    b1, b2 = (1.0 - a1) * i, (1.0 - a2) * i
    q1 = (1.0 - a1 * a1) * branch_variance + VARIANCE_STEP * p.capacity_ah**2
    q2 = (1.0 - a2 * a2) * branch_variance + VARIANCE_STEP * p.capacity_ah**2
    a00, a01, a02, a11, a12, a22 = keep * keep, keep * a1, keep * a2, a1 * a1, a1 * a2, a2 * a2
    for cell in range(block.shape[1]):
        t = temperature_degc[cell]
        if abs(t) < TEMPERATURE_MAX_DEGC:
            block[12 + TEMPERATURE, cell] = t
        else:
            t = block[12 + TEMPERATURE, cell]
        row, g = _place_temperature(grid, t)
        soc, i1, i2 = block[0, cell] - moved, a1 * block[1, cell] + b1, a2 * block[2, cell] + b2
        p00 = block[3, cell] * a00 + walk
        p01, p02 = block[4, cell] * a01, block[5, cell] * a02
        p11, p12, p22 = block[7, cell] * a11 + q1, block[8, cell] * a12, block[11, cell] * a22 + q2
        sd = math.sqrt(p00)
        reach, per_sd = p.spread * sd, p.spread / sd
        h0, r1, r2 = _point_pair(ocv, circuit, soc, row, g, i, over, i1, i2)
        up = _point_pair(ocv, circuit, soc + reach, row, g, i, over, i1 + p01 * per_sd, i2 + p02 * per_sd)[0]
        down = _point_pair(ocv, circuit, soc - reach, row, g, i, over, i1 - p01 * per_sd, i2 - p02 * per_sd)[0]
        q = up + down - 2.0 * h0
        predicted = h0 + p.weight * q
        if p.hysteresis_v != 0.0:
            block[12 + HYSTERESIS, cell] = block[12 + HYSTERESIS, cell] * follow - pull
            predicted += p.hysteresis_v * block[12 + HYSTERESIS, cell]
        steep = ((up - down) * 0.5 + (p01 * r1 + p02 * r2) * per_sd) / reach
        x0, x1, x2 = (
            p00 * steep - p01 * r1 - p02 * r2,
            p01 * steep - p11 * r1 - p12 * r2,
            p02 * steep - p12 * r1 - p22 * r2,
        )
        Pyy = p.curvature * q * q + (steep * x0 - r1 * x1 - r2 * x2)
        outside_k = max(grid[0] - t, 0.0) + max(t - grid[grid.size - 1], 0.0)
        model_v2 = _noise(p, soc, outside_k, noise_v2)
        S = Pyy + model_v2 * correlation
        expected = Pyy + model_v2
        v = voltage_v[cell]
        innovation = v - predicted if VOLTAGE_MIN_V < v < VOLTAGE_MAX_V else np.nan
        used, believed, refused = _gate(p, innovation, expected, block[12 + REFUSED, cell], dt)
        block[12 + REFUSED, cell] = refused
        if believed:
            p00 = _widened(p, p00, dt)
        if used:
            root = 1.0 / math.sqrt(S)
            z0, z1, z2 = x0 * root, x1 * root, x2 * root
            pulled = innovation * root
            soc, i1, i2 = soc + z0 * pulled, i1 + z1 * pulled, i2 + z2 * pulled
            p00, p01, p02 = p00 - z0 * z0, p01 - z0 * z1, p02 - z0 * z2
            p11, p12, p22 = p11 - z1 * z1, p12 - z1 * z2, p22 - z2 * z2
        soc = min(max(soc, SOC_MIN), SOC_MAX)
        block[0, cell], block[1, cell], block[2, cell] = soc, i1, i2
        block[3, cell], block[4, cell], block[5, cell] = p00, p01, p02
        block[6, cell], block[7, cell], block[8, cell] = p01, p11, p12
        block[9, cell], block[10, cell], block[11, cell] = p02, p12, p22
        out[OUT_VOLTAGE, cell] = predicted
        out[OUT_INNOVATION_SIGMA, cell] = math.sqrt(expected)
        out[OUT_ACCEPTED, cell] = 1.0 if used else 0.0
        _report(p, block, 12, cell, dt, moved, soc, p00, steep, check_scale, check_weight, innovation, used, ocv, out)


@_jit
def advance_any(block, ocv, circuit, tau, grid, numbers, dt, i, voltage_v, temperature_degc, out):
    """Advance all cells of a model with 0 to 4 RC pairs by one sample, with sigma points or the tangent."""
    p = Numbers(*to_fixed_tuple(numbers, N_NUMBERS))
    moved, walk, keep, branch_variance, noise_v2, correlation, over, check_scale, check_weight = _common(p, dt, i)
    follow = math.exp(-p.hysteresis_rate * abs(moved))
    pull = math.copysign(1.0 - follow, moved)
    m = tau.shape[0]
    d = m + 1
    has_over = circuit.shape[2] > d
    slow = d + d * d
    fixed = tau.size == m
    a = np.ones(d)
    acc = np.empty(d)
    r = np.empty(m)
    h = np.empty(3)
    if fixed:
        for k in range(m):
            a[k + 1] = math.exp(-dt / tau[k, 0, 0])
    for cell in range(block.shape[1]):
        t = temperature_degc[cell]
        if abs(t) < TEMPERATURE_MAX_DEGC:
            block[slow + TEMPERATURE, cell] = t
        else:
            t = block[slow + TEMPERATURE, cell]
        row, g = _place_temperature(grid, t)
        if not fixed:
            j, f = _place_soc(block[0, cell])
            up, top = min(j + 1, N_SOC - 1), min(row + 1, grid.size - 1)
            for k in range(m):
                low = tau[k, row, j] * (1.0 - f) + tau[k, row, up] * f
                high = tau[k, top, j] * (1.0 - f) + tau[k, top, up] * f
                a[k + 1] = math.exp(-dt / (low * (1.0 - g) + high * g))
        block[0, cell] -= moved
        for k in range(1, d):
            block[k, cell] = a[k] * block[k, cell] + (1.0 - a[k]) * i
        for u in range(d):
            for w in range(d):
                block[d + u * d + w, cell] *= (keep if u == 0 else a[u]) * (keep if w == 0 else a[w])
        block[d, cell] += walk
        for k in range(1, d):
            own = (1.0 - a[k] * a[k]) * branch_variance + VARIANCE_STEP * p.capacity_ah**2
            block[d + k * d + k, cell] += own
        soc, Pz = block[0, cell], block[d, cell]
        sd = math.sqrt(Pz)
        tangent = 0.0
        for point in range(3 if p.is_sigma != 0.0 else 1):
            per_sd = 0.0 if point == 0 else (p.spread / sd if point == 1 else -p.spread / sd)
            j, f = _place_soc(soc + per_sd * Pz)
            at = j + N_SOC * row
            value = ocv[j, 0] + f * ocv[j, 1] - i * _corner(circuit, at, 0, f, g)
            for k in range(m):
                rk = _corner(circuit, at, k + 1, f, g)
                if point == 0:
                    r[k] = rk
                value -= rk * (block[k + 1, cell] + per_sd * block[d + k + 1, cell])
            if has_over:
                value -= over * _corner(circuit, at, d, f, g)
            h[point] = value
            if p.is_sigma == 0.0:
                tangent = ocv[j, 2] + f * ocv[j, 3] - i * _corner_slope(circuit, at, 0, g)
                for k in range(m):
                    tangent -= _corner_slope(circuit, at, k + 1, g) * block[k + 1, cell]
                if has_over:
                    tangent -= over * _corner_slope(circuit, at, d, g)
        predicted, steep, Pyy = h[0], tangent, 0.0
        if p.is_sigma != 0.0:
            q = h[1] + h[2] - 2.0 * h[0]
            steep = (h[1] - h[2]) * 0.5
            for k in range(m):
                steep += block[d + k + 1, cell] * (p.spread / sd) * r[k]
            steep /= p.spread * sd
            predicted, Pyy = h[0] + p.weight * q, p.curvature * q * q
        if p.hysteresis_v != 0.0:
            block[slow + HYSTERESIS, cell] = block[slow + HYSTERESIS, cell] * follow - pull
            predicted += p.hysteresis_v * block[slow + HYSTERESIS, cell]
        for u in range(d):
            acc[u] = block[d + u, cell] * steep
            for k in range(m):
                acc[u] -= block[d + (k + 1) * d + u, cell] * r[k]
        Pyy += acc[0] * steep
        for k in range(m):
            Pyy -= r[k] * acc[k + 1]
        outside_k = max(grid[0] - t, 0.0) + max(t - grid[grid.size - 1], 0.0)
        model_v2 = _noise(p, soc, outside_k, noise_v2)
        S = Pyy + model_v2 * correlation
        expected = Pyy + model_v2
        v = voltage_v[cell]
        innovation = v - predicted if VOLTAGE_MIN_V < v < VOLTAGE_MAX_V else np.nan
        used, believed, refused = _gate(p, innovation, expected, block[slow + REFUSED, cell], dt)
        block[slow + REFUSED, cell] = refused
        if believed:
            block[d, cell] = _widened(p, Pz, dt)
        if used:
            root = 1.0 / math.sqrt(S)
            for u in range(d):
                acc[u] *= root
                block[u, cell] += acc[u] * (innovation * root)
            for u in range(d):
                for w in range(d):
                    block[d + u * d + w, cell] -= acc[u] * acc[w]
        block[0, cell] = min(max(block[0, cell], SOC_MIN), SOC_MAX)
        out[OUT_VOLTAGE, cell] = predicted
        out[OUT_INNOVATION_SIGMA, cell] = math.sqrt(expected)
        out[OUT_ACCEPTED, cell] = 1.0 if used else 0.0
        _report(p, block, slow, cell, dt, moved, block[0, cell], block[d, cell], steep, check_scale,
                check_weight, innovation, used, ocv, out)  # fmt: skip


@_jit
def record_pair(block, ocv, circuit, tau, grid, numbers, dt_s, current_a, voltage_v, temperature_degc, out):
    """Run `advance_pair` over (n_steps,) samples; `out` is (n_steps, 8, n_cells)."""
    for k in range(dt_s.size):
        advance_pair(block, ocv, circuit, tau, grid, numbers, dt_s[k], current_a[k], voltage_v[k],
                     temperature_degc[k], out[k])  # fmt: skip


@_jit
def record_any(block, ocv, circuit, tau, grid, numbers, dt_s, current_a, voltage_v, temperature_degc, out):
    """Run `advance_any` over (n_steps,) samples; `out` is (n_steps, 8, n_cells)."""
    for k in range(dt_s.size):
        advance_any(block, ocv, circuit, tau, grid, numbers, dt_s[k], current_a[k], voltage_v[k],
                    temperature_degc[k], out[k])  # fmt: skip
