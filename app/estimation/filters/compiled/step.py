"""Compiled: one step of the filter over all cells. The equations are those of `process`, `outputs` and `marginal`.

Only the look-ups go from cell to cell; what stands before and after them is written so that the compiler computes
several cells at a time: loops over cells without branches, over rows it knows to be apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import carray  # type: ignore[attr-defined]

from app.estimation.cell_model.circuit import SECONDS_PER_HOUR
from app.estimation.filters.compiled.fusion import make_report
from app.estimation.filters.compiled.parts import jit, moved_soc, noise_variance, soc_walk
from app.estimation.filters.compiled.shape import (
    BRANCH_C,
    BRANCH_REL,
    CAPACITY_AH,
    COLD_FACTOR,
    CORRELATION_S,
    COUNTER_GAIN,
    COUNTER_OFFSET_C,
    CURVATURE,
    EMPTY_SLOPE,
    EMPTY_SOC,
    GATE,
    GATE_HOLD_S,
    GATE_RECOVERY,
    HERE,
    HYSTERESIS_RATE,
    HYSTERESIS_V,
    I_REF,
    LEFT,
    N_WORK,
    OCV_SLOPE,
    PLACE_NOISE,
    PLACE_OFFSET,
    PLACE_WEIGHT,
    PLACED,
    REACH,
    RIGHT,
    SPREAD,
    STEEP,
    WEIGHT,
    Shape,
    columns,
    layout,
    table_width,
)
from app.estimation.filters.estimates import (
    N_OUT,
    OUT_ACCEPTED,
    OUT_INNOVATION,
    OUT_INNOVATION_SIGMA,
    OUT_OCV,
    OUT_SOC,
    OUT_VOLTAGE,
)
from app.estimation.filters.inputs import TEMPERATURE_MAX_DEGC, VOLTAGE_MAX_V, VOLTAGE_MIN_V
from app.estimation.filters.marginal import SOC_MAX, SOC_MIN
from app.estimation.filters.outputs import SOC_HIGH
from app.estimation.filters.process import SOC_VARIANCE_MAX, VARIANCE_STEP
from app.estimation.filters.states import (
    COUNT,
    COUNT_GAIN,
    COUNT_OFFSET,
    HYSTERESIS,
    N_SLOW,
    REFUSED,
    RESISTANCE,
    TEMPERATURE,
)
from app.estimation.filters.tables import N_SOC, SOC_LOW, SOC_STEP

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
# ruff: noqa: ANN001, ANN202


def make_place(shape: Shape) -> Any:
    """Finds the rows of the table for the temperatures that have changed."""
    n, d = shape.n, 1 + shape.m
    KNOWN = (d + d * d + TEMPERATURE) * n
    AT, OFFSET, WEIGHT, NOISE = PLACED * n, PLACE_OFFSET * n, PLACE_WEIGHT * n, PLACE_NOISE * n

    @jit
    def place(block, grid, numbers, temperature_degc, placed):
        n_moved = 0
        for c in range(n):
            t = temperature_degc[c]
            n_moved += 0 if (t == placed[AT + c]) & (t == block[KNOWN + c]) else 1
        if n_moved == 0:
            return
        for c in range(n):
            t = temperature_degc[c] if abs(temperature_degc[c]) < TEMPERATURE_MAX_DEGC else block[KNOWN + c]
            if t == placed[AT + c]:
                continue
            block[KNOWN + c] = placed[AT + c] = t
            row, weight = 0, 0.0
            if grid.size > 1:
                while row < grid.size - 2 and t >= grid[row + 1]:
                    row += 1
                weight = min(max((t - grid[row]) / (grid[row + 1] - grid[row]), 0.0), 1.0)
            outside_k = max(grid[0] - t, 0.0) + max(t - grid[grid.size - 1], 0.0)
            cold = 1.0 + numbers[COLD_FACTOR] * outside_k / 10.0
            placed[OFFSET + c], placed[WEIGHT + c], placed[NOISE + c] = N_SOC * row, weight, cold * cold

    return place


def make_predict(shape: Shape) -> Any:
    """The equations of `process`, which also says where the sigma points lie."""
    n, m, d = shape.n, shape.m, 1 + shape.m
    is_fixed, is_sigma, is_fused = shape.is_fixed, shape.is_sigma, shape.is_fused
    SLOW = d + d * d
    HYSTERESIS_AT, COUNTED = (SLOW + HYSTERESIS) * n, (SLOW + COUNT) * n
    GAIN, OFFSET = (SLOW + COUNT_GAIN) * n, (SLOW + COUNT_OFFSET) * n
    COV = d * n
    X, XR, XL, R = HERE * n, RIGHT * n, LEFT * n, REACH * n
    SHIFT, DECAY = N_WORK * n, (N_WORK + m) * n
    T_OFFSET, T_WEIGHT = PLACE_OFFSET * n, PLACE_WEIGHT * n
    TOP, PER_STEP, ORIGIN = N_SOC - 1.0, 1.0 / SOC_STEP, -SOC_LOW / SOC_STEP

    @jit
    def predict(block, tau, numbers, dt, i, placed, work):
        moved = moved_soc(numbers, dt, i)
        walk, keep = soc_walk(numbers, dt)
        branch_a, branch_floor_a = numbers[BRANCH_REL] * i, numbers[BRANCH_C] * numbers[CAPACITY_AH]
        branch_variance = branch_a * branch_a + branch_floor_a * branch_floor_a
        floor_v2 = VARIANCE_STEP * (numbers[CAPACITY_AH] * numbers[CAPACITY_AH])
        for k in range(m):
            if is_fixed:
                a = math.exp(-dt / tau[k])
                for c in range(n):
                    work[DECAY + k * n + c] = a
            else:
                for c in range(n):
                    x = min(max((block[c] - SOC_LOW) * PER_STEP, 0.0), TOP)
                    j = int(x)
                    f, g = x - j, placed[T_WEIGHT + c]
                    row = k * (tau.size // m) + int(placed[T_OFFSET + c])
                    up = min(j + 1, N_SOC - 1)
                    low = tau[row + j] * (1.0 - f) + tau[row + up] * f
                    row += N_SOC if g > 0.0 else 0
                    high = tau[row + j] * (1.0 - f) + tau[row + up] * f
                    work[DECAY + k * n + c] = math.exp(-dt / (low * (1.0 - g) + high * g))
        if numbers[HYSTERESIS_V] != 0.0:
            follow = math.exp(-numbers[HYSTERESIS_RATE] * abs(moved))
            pull = math.copysign(1.0 - follow, moved)
            for c in range(n):
                block[HYSTERESIS_AT + c] = block[HYSTERESIS_AT + c] * follow - pull
        if is_fused:
            gain, offset = numbers[COUNTER_GAIN] * moved, numbers[COUNTER_OFFSET_C] / SECONDS_PER_HOUR * dt
            for c in range(n):
                block[COUNTED + c] -= moved
                block[GAIN + c] += gain
                block[OFFSET + c] += offset
        for c in range(n):
            soc = block[c] - moved
            block[c] = soc
            variance = block[COV + c] * (keep * keep) + walk
            block[COV + c] = variance
            sd = math.sqrt(variance)
            per_sd = numbers[SPREAD] / sd
            reach = variance * per_sd
            for k in range(m):
                a = work[DECAY + k * n + c]
                block[(1 + k) * n + c] = block[(1 + k) * n + c] * a + (1.0 - a) * i
                shared = block[COV + (1 + k) * n + c] * (keep * a)
                block[COV + (1 + k) * n + c] = shared
                block[COV + (1 + k) * d * n + c] = shared
                work[SHIFT + k * n + c] = shared * per_sd
                for q in range(k):
                    both = block[COV + (1 + k + (1 + q) * d) * n + c] * (a * work[DECAY + q * n + c])
                    block[COV + (1 + k + (1 + q) * d) * n + c] = both
                    block[COV + (1 + q + (1 + k) * d) * n + c] = both
                own = block[COV + (1 + k) * (1 + d) * n + c] * (a * a)
                block[COV + (1 + k) * (1 + d) * n + c] = own + ((1.0 - a * a) * branch_variance + floor_v2)
            if is_sigma:
                work[R + c] = reach
                right, left = soc + reach, soc - reach
                right = right if right > SOC_LOW else SOC_LOW
                work[XR + c] = (right if right < SOC_HIGH else SOC_HIGH) * PER_STEP + ORIGIN
                left = left if left > SOC_LOW else SOC_LOW
                work[XL + c] = (left if left < SOC_HIGH else SOC_HIGH) * PER_STEP + ORIGIN
            x = soc if soc > SOC_LOW else SOC_LOW
            work[X + c] = (x if x < SOC_HIGH else SOC_HIGH) * PER_STEP + ORIGIN

    return predict


def make_look_up(shape: Shape) -> Any:
    """Looks up the terms of the output at the points; for the tangent also its slope."""
    n, m, is_sigma, has_over = shape.n, shape.m, shape.is_sigma, shape.has_over
    C = columns(shape)
    X, STEEP_AT, SLOPE_AT, TERMS = HERE * n, STEEP * n, OCV_SLOPE * n, (N_WORK + 3 * m + 1) * n
    T_OFFSET, T_WEIGHT = PLACE_OFFSET * n, PLACE_WEIGHT * n
    WIDTH, BY_SOC, BY_T, BY_BOTH, SLOPE = table_width(shape), C, 2 * C, 3 * C, 4 * C
    N_POINTS, FIRST = 3 if is_sigma else 1, 2 + has_over
    d = 1 + m
    RESISTANCE_AT = (d + d * d + RESISTANCE) * n

    @jit
    def look_up(block, table, i, over, placed, work):
        for c in range(n):
            g, resistance, row = placed[T_WEIGHT + c], block[RESISTANCE_AT + c], int(placed[T_OFFSET + c])
            for point in range(N_POINTS):
                x = work[X + point * n + c]
                j = int(x)
                f = x - j
                at, to = (j + row) * WIDTH, TERMS + (point * n + c) * C
                for q in range(0, C, 4):
                    a0, a1, a2, a3 = at + q, at + q + 1, at + q + 2, at + q + 3
                    y0 = table[a0] + table[a0 + BY_T] * g + (table[a0 + BY_SOC] + table[a0 + BY_BOTH] * g) * f
                    y1 = table[a1] + table[a1 + BY_T] * g + (table[a1 + BY_SOC] + table[a1 + BY_BOTH] * g) * f
                    y2 = table[a2] + table[a2 + BY_T] * g + (table[a2 + BY_SOC] + table[a2 + BY_BOTH] * g) * f
                    y3 = table[a3] + table[a3 + BY_T] * g + (table[a3 + BY_SOC] + table[a3 + BY_BOTH] * g) * f
                    work[to + q] = y0 * resistance if q else y0
                    work[to + q + 1], work[to + q + 2] = y1 * resistance, y2 * resistance
                    work[to + q + 3] = y3 * resistance
                if not is_sigma:
                    tangent = (table[at + BY_SOC + 1] + table[at + BY_BOTH + 1] * g) * i
                    for k in range(m):
                        slope = table[at + BY_SOC + FIRST + k] + table[at + BY_BOTH + FIRST + k] * g
                        tangent += slope * block[(1 + k) * n + c]
                    if has_over:
                        tangent += (table[at + BY_SOC + 2] + table[at + BY_BOTH + 2] * g) * over
                    slope = table[at + SLOPE] + f * table[at + SLOPE + 1]
                    work[SLOPE_AT + c], work[STEEP_AT + c] = slope, slope + tangent * resistance * (1.0 / SOC_STEP)

    return look_up


def make_update(shape: Shape) -> Any:
    """The equations of `marginal`."""
    n, m, d, is_sigma = shape.n, shape.m, 1 + shape.m, shape.is_sigma
    SLOW = d + d * d
    HYSTERESIS_AT, REFUSED_AT = (SLOW + HYSTERESIS) * n, (SLOW + REFUSED) * n
    COV = d * n
    R, STEEP_AT, SLOPE_AT, ACCEPTED_AT = REACH * n, STEEP * n, OCV_SLOPE * n, OUT_ACCEPTED * n
    SHIFT, Z, C = N_WORK * n, (N_WORK + 2 * m) * n, columns(shape)
    TERMS = (N_WORK + 3 * m + 1) * n
    has_over = shape.has_over
    FIRST, TO_RIGHT, TO_LEFT = 2 + has_over, n * C, 2 * n * C
    VOLTAGE_AT, INNOVATION_AT, SIGMA_AT = OUT_VOLTAGE * n, OUT_INNOVATION * n, OUT_INNOVATION_SIGMA * n
    T_NOISE = PLACE_NOISE * n
    NAN = np.nan

    @jit
    def update(block, numbers, dt, i, over, voltage_v, placed, work, out):
        noise_v2 = noise_variance(numbers, i)
        lasting_v2 = noise_v2 * (1.0 + 2.0 * numbers[CORRELATION_S] / max(dt, 1e-3))
        gate_v2 = numbers[GATE] * numbers[GATE]
        widening = numbers[GATE_RECOVERY] * numbers[GATE_RECOVERY] * dt
        hold_s, empty_soc, empty_slope, hysteresis_v = (
            numbers[GATE_HOLD_S],
            numbers[EMPTY_SOC],
            numbers[EMPTY_SLOPE],
            numbers[HYSTERESIS_V],
        )
        weight, curvature = numbers[WEIGHT], numbers[CURVATURE]
        for c in range(n):
            h0 = work[TERMS + c * C] + work[TERMS + c * C + 1] * i
            for k in range(m):
                h0 += work[TERMS + c * C + FIRST + k] * block[(1 + k) * n + c]
            if has_over:
                h0 += work[TERMS + c * C + 2] * over
            predicted, Pyy, steep = h0, 0.0, work[STEEP_AT + c]
            if is_sigma:
                # beyond the centre's values, so that small differences keep their digits
                right, left = work[TERMS + TO_RIGHT + c * C], work[TERMS + TO_LEFT + c * C]
                right -= work[TERMS + c * C]
                left -= work[TERMS + c * C]
                work[SLOPE_AT + c] = (right - left) * 0.5 / work[R + c]
                here = work[TERMS + c * C + 1]
                right += (work[TERMS + TO_RIGHT + c * C + 1] - here) * i
                left += (work[TERMS + TO_LEFT + c * C + 1] - here) * i
                for k in range(m):
                    current, shift, here = (
                        block[(1 + k) * n + c],
                        work[SHIFT + k * n + c],
                        work[TERMS + c * C + FIRST + k],
                    )
                    right += (work[TERMS + TO_RIGHT + c * C + FIRST + k] - here) * (current + shift)
                    left += (work[TERMS + TO_LEFT + c * C + FIRST + k] - here) * (current - shift)
                if has_over:
                    here = work[TERMS + c * C + 2]
                    right += (work[TERMS + TO_RIGHT + c * C + 2] - here) * over
                    left += (work[TERMS + TO_LEFT + c * C + 2] - here) * over
                steep = (right - left) * 0.5 / work[R + c]
                q = right + left
                predicted = q * weight + h0
                Pyy = q * q * curvature
                work[STEEP_AT + c] = steep
            predicted += hysteresis_v * block[HYSTERESIS_AT + c]
            for u in range(d):
                Pxy = block[COV + u * n + c] * steep
                for k in range(m):
                    Pxy += block[COV + ((1 + k) * d + u) * n + c] * work[TERMS + c * C + FIRST + k]
                work[Z + u * n + c] = Pxy
                Pyy += Pxy * (steep if u == 0 else work[TERMS + c * C + FIRST + u - 1])
            soc = block[c]
            low = empty_soc - soc
            low = (low if low > 0.0 else 0.0) * empty_slope + 1.0
            growth = low * placed[T_NOISE + c]
            expected = Pyy + growth * noise_v2
            v = voltage_v[c]
            innovation = (v if (v > VOLTAGE_MIN_V) & (v < VOLTAGE_MAX_V) else NAN) - predicted
            is_inside = innovation * innovation <= expected * gate_v2
            is_missing = innovation != innovation
            refused_s = block[REFUSED_AT + c]
            refused_s = 0.0 if is_inside else (refused_s if is_missing else refused_s + dt)
            block[REFUSED_AT + c] = refused_s
            believed = (not is_inside) & (not is_missing) & (refused_s > hold_s)
            is_used = is_inside | believed
            variance = block[COV + c]
            wide = variance + widening
            wide = wide if wide < SOC_VARIANCE_MAX else SOC_VARIANCE_MAX
            block[COV + c] = wide if believed & (wide > variance) else variance
            root = 1.0 / math.sqrt(Pyy + growth * lasting_v2)
            pulled = innovation * root if is_used else 0.0
            root = root if is_used else 0.0
            for u in range(d):
                z = work[Z + u * n + c] * root
                work[Z + u * n + c] = z
                block[u * n + c] += z * pulled
                for w in range(u + 1):
                    P = block[COV + (w * d + u) * n + c] - z * work[Z + w * n + c]
                    block[COV + (w * d + u) * n + c] = P
                    block[COV + (u * d + w) * n + c] = P
            soc = block[c]
            soc = soc if soc > SOC_MIN else SOC_MIN
            block[c] = soc if soc < SOC_MAX else SOC_MAX
            out[VOLTAGE_AT + c] = predicted
            out[INNOVATION_AT + c] = innovation
            out[SIGMA_AT + c] = math.sqrt(expected)
            out[ACCEPTED_AT + c] = 1.0 if is_used else 0.0

    return update


def make_kernels(shape: Shape) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return the step and the record of a filter over `shape.n` cells, not compiled yet.

    Both take pointers: to the block of `CellStates` and to the arena, which holds sample and answer of a step. A
    record takes its own.
    """
    n, m = shape.n, shape.m
    WIDTH, BY_SOC, has_over = table_width(shape), columns(shape), shape.has_over
    SOC_AT, OCV_AT, SLOPE_AT = OUT_SOC * n, OUT_OCV * n, OCV_SLOPE * n
    GRID, TAU, TABLE, PLACES, WORK, STEP, VOLTS, DEGC, ANSWER, END = layout(shape)
    BLOCK = ((1 + m) * (2 + m) + N_SLOW) * n
    place, predict, look_up, update, report = (
        make_place(shape),
        make_predict(shape),
        make_look_up(shape),
        make_update(shape),
        make_report(shape),
    )

    @jit
    def advance(block, arena, dt, i, voltage_v, temperature_degc, out):
        numbers, table, placed, work = arena[:GRID], arena[TABLE:PLACES], arena[PLACES:WORK], arena[WORK:STEP]
        over = math.asinh(i / numbers[I_REF]) if has_over else 0.0
        place(block, arena[GRID:TAU], numbers, temperature_degc, placed)
        predict(block, arena[TAU:TABLE], numbers, dt, i, placed, work)
        look_up(block, table, i, over, placed, work)
        update(block, numbers, dt, i, over, voltage_v, placed, work, out)
        report(block, work[SLOPE_AT : SLOPE_AT + n], numbers, dt, i, out)
        for c in range(n):
            soc = out[SOC_AT + c]
            x = min(max((soc - SOC_LOW) * (1.0 / SOC_STEP), 0.0), N_SOC - 1.0)
            j = int(x)
            out[OCV_AT + c] = table[j * WIDTH] + (x - j) * table[j * WIDTH + BY_SOC]
            out[SOC_AT + c] = min(max(soc, 0.0), 1.0)

    def step(block_at, arena_at):
        block, arena = carray(block_at, BLOCK), carray(arena_at, END)
        dt, i = arena[STEP], arena[STEP + 1]
        advance(block, arena, dt, i, arena[VOLTS:DEGC], arena[DEGC:ANSWER], arena[ANSWER:END])

    def record(block_at, arena_at, steps, dt_at, current_at, voltage_at, temperature_at, out_at):
        block, arena, out = carray(block_at, BLOCK), carray(arena_at, END), carray(out_at, steps * N_OUT * n)
        dt_s, current_a = carray(dt_at, steps), carray(current_at, steps)
        volts, degc = carray(voltage_at, steps * n), carray(temperature_at, steps * n)
        for k in range(steps):
            now, begin, end = out[k * N_OUT * n : (k + 1) * N_OUT * n], k * n, (k + 1) * n
            advance(block, arena, dt_s[k], current_a[k], volts[begin:end], degc[begin:end], now)

    return step, record
