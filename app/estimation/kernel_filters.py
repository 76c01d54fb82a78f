"""Compiled: one step of the filter over all cells, its fusion and self-check included.

`advance_pair` writes the algebra of two RC pairs out in scalars that stay in registers, which is what almost every
cell file holds; `advance_any` loops over 0 to 4 pairs. Both read and write the block of `CellStates`.
"""

from __future__ import annotations

import math

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from app.estimation.inputs import TEMPERATURE_MAX_DEGC, VOLTAGE_MAX_V, VOLTAGE_MIN_V
from app.estimation.kernel_fusion import finish
from app.estimation.kernel_parts import (
    FLAG_ACCEPTED,
    FLAG_VALID,
    N_NUMBERS,
    OUT_INNOVATION,
    OUT_INNOVATION_SIGMA,
    OUT_OCV,
    OUT_SIGMA,
    OUT_SOC,
    OUT_VOLTAGE,
    Numbers,
    blend,
    common,
    gate,
    jit,
    noise,
    place_soc,
    widened,
)
from app.estimation.marginal import SOC_MAX, SOC_MIN
from app.estimation.process import VARIANCE_STEP
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
    SLOW_MEAN,
    SLOW_SQUARE,
    TEMPERATURE,
)
from app.estimation.tables import N_SOC, SOC_STEP

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg"
# ruff: noqa: ANN001, ANN201


@jit
def advance_pair(block, ocv, circuit, tau, grid, numbers, dt, i, voltage_v, temperature_degc, out, flags):
    """Advance all cells of a two-RC model with fixed time constants by one sample, with sigma points."""
    p = Numbers(*to_fixed_tuple(numbers, N_NUMBERS))
    moved, walk, keep, branch_variance, noise_v2, correlation, over, check = common(p, dt, i)
    follow = math.exp(-p.hysteresis_rate * abs(moved))
    pull = math.copysign(1.0 - follow, moved)
    a1, a2 = math.exp(-dt / tau[0, 0, 0]), math.exp(-dt / tau[1, 0, 0])
    b1, b2 = (1.0 - a1) * i, (1.0 - a2) * i
    q1 = (1.0 - a1 * a1) * branch_variance + VARIANCE_STEP * p.capacity_ah**2
    q2 = (1.0 - a2 * a2) * branch_variance + VARIANCE_STEP * p.capacity_ah**2
    has_over = circuit.shape[2] > 3
    a00, a01, a02, a11, a12, a22 = keep * keep, keep * a1, keep * a2, a1 * a1, a1 * a2, a2 * a2
    for cell in range(block.shape[1]):
        t = temperature_degc[cell]
        if abs(t) < TEMPERATURE_MAX_DEGC:
            block[12 + TEMPERATURE, cell] = t
        else:
            t = block[12 + TEMPERATURE, cell]
        row, g = 0, 0.0
        if grid.size > 1:
            while row < grid.size - 2 and t >= grid[row + 1]:
                row += 1
            g = min(max((t - grid[row]) / (grid[row + 1] - grid[row]), 0.0), 1.0)
        soc, i1, i2 = block[0, cell] - moved, a1 * block[1, cell] + b1, a2 * block[2, cell] + b2
        p00 = block[3, cell] * a00 + walk
        p01, p02 = block[4, cell] * a01, block[5, cell] * a02
        p11, p12, p22 = block[7, cell] * a11 + q1, block[8, cell] * a12, block[11, cell] * a22 + q2
        sd = math.sqrt(p00)
        reach, per_sd = p.spread * sd, p.spread / sd
        h0, up, down, r1, r2, rise = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for point in range(3):
            away = 0.0 if point == 0 else (per_sd if point == 1 else -per_sd)
            j, f = place_soc(soc + away * p00)
            at = j + N_SOC * row
            rest = ocv[j, 0] + f * ocv[j, 1]
            h = rest - i * blend(circuit[at, 0, 0], circuit[at, 1, 0], circuit[at, 2, 0], circuit[at, 3, 0], f, g)
            ra = blend(circuit[at, 0, 1], circuit[at, 1, 1], circuit[at, 2, 1], circuit[at, 3, 1], f, g)
            rb = blend(circuit[at, 0, 2], circuit[at, 1, 2], circuit[at, 2, 2], circuit[at, 3, 2], f, g)
            h -= ra * (i1 + away * p01) + rb * (i2 + away * p02)
            if has_over:
                h -= over * blend(circuit[at, 0, 3], circuit[at, 1, 3], circuit[at, 2, 3], circuit[at, 3, 3], f, g)
            if point == 0:
                h0, r1, r2 = h, ra, rb
            elif point == 1:
                up, rise = h, rest
            else:
                down, rise = h, rise - rest
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
        model_v2 = noise(p, soc, outside_k, noise_v2)
        S = Pyy + model_v2 * correlation
        expected = Pyy + model_v2
        v = voltage_v[cell]
        innovation = v - predicted if VOLTAGE_MIN_V < v < VOLTAGE_MAX_V else np.nan
        used, believed, refused = gate(p, innovation, expected, block[12 + REFUSED, cell], dt)
        block[12 + REFUSED, cell] = refused
        if believed:
            p00 = widened(p, p00, dt)
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
        (
            soc, variance, valid, block[12 + CHECK_MEAN, cell], block[12 + CHECK_SQUARE, cell],
            block[12 + SLOW_MEAN, cell], block[12 + SLOW_SQUARE, cell],
            block[12 + COUNT, cell], block[12 + COUNT_GAIN, cell], block[12 + COUNT_OFFSET, cell],
            block[12 + ANCHOR_V2, cell], block[12 + DOUBT, cell],
        ) = finish(
            p, dt, moved, soc, p00, rise * 0.5 / reach, innovation, used, check,
            block[12 + CHECK_MEAN, cell], block[12 + CHECK_SQUARE, cell], block[12 + SLOW_MEAN, cell],
            block[12 + SLOW_SQUARE, cell], block[12 + COUNT, cell], block[12 + COUNT_GAIN, cell],
            block[12 + COUNT_OFFSET, cell], block[12 + ANCHOR_V2, cell], block[12 + DOUBT, cell],
        )  # fmt: skip
        j, f = place_soc(soc)
        out[OUT_SOC, cell] = min(max(soc, 0.0), 1.0)
        out[OUT_SIGMA, cell] = math.sqrt(variance)
        out[OUT_OCV, cell] = ocv[j, 0] + f * ocv[j, 1]
        out[OUT_VOLTAGE, cell] = predicted
        out[OUT_INNOVATION, cell] = innovation
        out[OUT_INNOVATION_SIGMA, cell] = math.sqrt(expected)
        flags[FLAG_VALID, cell] = valid
        flags[FLAG_ACCEPTED, cell] = used


@jit
def advance_any(block, ocv, circuit, tau, grid, numbers, dt, i, voltage_v, temperature_degc, out, flags):
    """Advance all cells of a model with 0 to 4 RC pairs by one sample, with sigma points or the tangent."""
    p = Numbers(*to_fixed_tuple(numbers, N_NUMBERS))
    moved, walk, keep, branch_variance, noise_v2, correlation, over, check = common(p, dt, i)
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
        row, g = 0, 0.0
        if grid.size > 1:
            while row < grid.size - 2 and t >= grid[row + 1]:
                row += 1
            g = min(max((t - grid[row]) / (grid[row + 1] - grid[row]), 0.0), 1.0)
        if not fixed:
            j, f = place_soc(block[0, cell])
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
        tangent, slope = 0.0, 0.0
        for point in range(3 if p.is_sigma != 0.0 else 1):
            per_sd = 0.0 if point == 0 else (p.spread / sd if point == 1 else -p.spread / sd)
            j, f = place_soc(soc + per_sd * Pz)
            at = j + N_SOC * row
            value = ocv[j, 0] + f * ocv[j, 1]
            if point > 0:
                slope = value - slope if point == 2 else value
            value -= i * blend(circuit[at, 0, 0], circuit[at, 1, 0], circuit[at, 2, 0], circuit[at, 3, 0], f, g)
            for k in range(1, d):
                rk = blend(circuit[at, 0, k], circuit[at, 1, k], circuit[at, 2, k], circuit[at, 3, k], f, g)
                if point == 0:
                    r[k - 1] = rk
                value -= rk * (block[k, cell] + per_sd * block[d + k, cell])
            if has_over:
                value -= over * blend(circuit[at, 0, d], circuit[at, 1, d], circuit[at, 2, d], circuit[at, 3, d], f, g)
            h[point] = value
            if p.is_sigma == 0.0:
                tangent = i * (circuit[at, 1, 0] + g * circuit[at, 3, 0])
                for k in range(1, d):
                    tangent += (circuit[at, 1, k] + g * circuit[at, 3, k]) * block[k, cell]
                if has_over:
                    tangent += over * (circuit[at, 1, d] + g * circuit[at, 3, d])
                slope = ocv[j, 2] + f * ocv[j, 3]
                tangent = slope - tangent * (1.0 / SOC_STEP)
        predicted, steep, Pyy = h[0], tangent, 0.0
        if p.is_sigma != 0.0:
            q = h[1] + h[2] - 2.0 * h[0]
            steep = (h[1] - h[2]) * 0.5
            for k in range(m):
                steep += block[d + k + 1, cell] * (p.spread / sd) * r[k]
            steep /= p.spread * sd
            slope *= -0.5 / (p.spread * sd)
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
        model_v2 = noise(p, soc, outside_k, noise_v2)
        S = Pyy + model_v2 * correlation
        expected = Pyy + model_v2
        v = voltage_v[cell]
        innovation = v - predicted if VOLTAGE_MIN_V < v < VOLTAGE_MAX_V else np.nan
        used, believed, refused = gate(p, innovation, expected, block[slow + REFUSED, cell], dt)
        block[slow + REFUSED, cell] = refused
        if believed:
            block[d, cell] = widened(p, Pz, dt)
        if used:
            root = 1.0 / math.sqrt(S)
            for u in range(d):
                acc[u] *= root
                block[u, cell] += acc[u] * (innovation * root)
            for u in range(d):
                for w in range(d):
                    block[d + u * d + w, cell] -= acc[u] * acc[w]
        block[0, cell] = min(max(block[0, cell], SOC_MIN), SOC_MAX)
        (
            soc, variance, valid, block[slow + CHECK_MEAN, cell], block[slow + CHECK_SQUARE, cell],
            block[slow + SLOW_MEAN, cell], block[slow + SLOW_SQUARE, cell],
            block[slow + COUNT, cell], block[slow + COUNT_GAIN, cell], block[slow + COUNT_OFFSET, cell],
            block[slow + ANCHOR_V2, cell], block[slow + DOUBT, cell],
        ) = finish(
            p, dt, moved, block[0, cell], block[d, cell], slope, innovation, used, check,
            block[slow + CHECK_MEAN, cell], block[slow + CHECK_SQUARE, cell], block[slow + SLOW_MEAN, cell],
            block[slow + SLOW_SQUARE, cell], block[slow + COUNT, cell], block[slow + COUNT_GAIN, cell],
            block[slow + COUNT_OFFSET, cell], block[slow + ANCHOR_V2, cell], block[slow + DOUBT, cell],
        )  # fmt: skip
        j, f = place_soc(soc)
        out[OUT_SOC, cell] = min(max(soc, 0.0), 1.0)
        out[OUT_SIGMA, cell] = math.sqrt(variance)
        out[OUT_OCV, cell] = ocv[j, 0] + f * ocv[j, 1]
        out[OUT_VOLTAGE, cell] = predicted
        out[OUT_INNOVATION, cell] = innovation
        out[OUT_INNOVATION_SIGMA, cell] = math.sqrt(expected)
        flags[FLAG_VALID, cell] = valid
        flags[FLAG_ACCEPTED, cell] = used
