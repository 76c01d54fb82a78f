"""Compiled: sigma, fusion with the charge count and self-check, after the update of all cells.

The equations are those of `filters`, `fusion` and `self_check`, in the same order; tests pin both to each other.
"""

from __future__ import annotations

import math
from typing import Any

from app.estimation.filters.compiled.parts import jit, noise_variance
from app.estimation.filters.compiled.shape import (
    ANCHOR_FACTOR,
    ANCHOR_S,
    BIAS_S,
    BIAS_V,
    CHECK_BIAS_V,
    CHECK_RMS_V,
    CHECK_S,
    DOUBT_SOC,
    MODEL_ERROR_V,
    UNKNOWN_ODDS,
    WANDER_FACTOR,
    WANDER_S,
    Shape,
)
from app.estimation.filters.estimates import OUT_ACCEPTED, OUT_INNOVATION, OUT_SIGMA, OUT_SOC, OUT_VALID
from app.estimation.filters.process import SOC_VARIANCE_MAX
from app.estimation.filters.start import SLOPE_FLOOR_V
from app.estimation.filters.states import (
    ANCHOR_V2,
    APART,
    CHECK_MEAN,
    CHECK_SQUARE,
    COUNT,
    COUNT_GAIN,
    COUNT_OFFSET,
    DOUBT,
    SLOW_MEAN,
    SLOW_SQUARE,
    WANDER,
)

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
# ruff: noqa: ANN001, ANN202

# ruff: noqa: ANN001


def make_report(shape: Shape) -> Any:
    """Reports SOC, sigma and validity from what the update left."""
    n, d = shape.n, 1 + shape.m
    is_fused = shape.is_fused
    VARIANCE = d * n  # of the SOC
    SLOW = d + d * d
    MEAN, SQUARE = (SLOW + CHECK_MEAN) * n, (SLOW + CHECK_SQUARE) * n
    SLOW_AT, SLOW_V2 = (SLOW + SLOW_MEAN) * n, (SLOW + SLOW_SQUARE) * n
    COUNTED, GAIN, OFFSET = (SLOW + COUNT) * n, (SLOW + COUNT_GAIN) * n, (SLOW + COUNT_OFFSET) * n
    APART_AT, WANDER_AT = (SLOW + APART) * n, (SLOW + WANDER) * n
    ANCHOR, DOUBTED = (SLOW + ANCHOR_V2) * n, (SLOW + DOUBT) * n
    SOC_AT, SIGMA_AT, INNOVATION_AT = OUT_SOC * n, OUT_SIGMA * n, OUT_INNOVATION * n
    VALID_AT, ACCEPTED_AT = OUT_VALID * n, OUT_ACCEPTED * n

    @jit
    def report(block, slope, numbers, dt, i, out):
        bias_v2 = numbers[BIAS_V] * numbers[BIAS_V]
        floor_v2 = SLOPE_FLOOR_V * SLOPE_FLOOR_V
        scale = numbers[MODEL_ERROR_V] / math.sqrt(noise_variance(numbers, i))
        share = 1.0 - math.exp(-dt / numbers[CHECK_S])
        slow_share = 1.0 - math.exp(-dt / numbers[BIAS_S])
        rms_v2, bias_v = numbers[CHECK_RMS_V] * numbers[CHECK_RMS_V], numbers[CHECK_BIAS_V]
        wander_share = 1.0 - math.exp(-dt / numbers[WANDER_S])
        wander2_share = wander_share * (1.0 - wander_share)
        odds, anchor_s, anchor_factor = numbers[UNKNOWN_ODDS], numbers[ANCHOR_S], numbers[ANCHOR_FACTOR]
        wander_factor, total_max = numbers[WANDER_FACTOR], numbers[DOUBT_SOC] * numbers[DOUBT_SOC]
        for c in range(n):
            slope_v2 = slope[c] * slope[c]
            slope_v2 = slope_v2 if slope_v2 > floor_v2 else floor_v2
            variance = (block[SLOW_V2 + c] + bias_v2) / slope_v2 + block[VARIANCE + c]
            variance = variance if variance < SOC_VARIANCE_MAX else SOC_VARIANCE_MAX
            soc = block[c]
            if is_fused:
                gain, offset = block[GAIN + c], block[OFFSET + c]
                count_v2 = gain * gain + offset * offset + block[ANCHOR + c]
                d = soc - block[COUNTED + c]
                apart, wander = block[APART_AT + c], block[WANDER_AT + c]
                beyond = d - apart
                wander += (beyond * wander_factor * beyond - wander) * wander2_share
                apart += beyond * wander_share
                variance += wander
                variance = variance if variance < SOC_VARIANCE_MAX else SOC_VARIANCE_MAX
                block[WANDER_AT + c] = wander
                total = count_v2 + variance
                total = total if total < total_max else total_max
                d2 = d * d
                tail = d2 / total * (1.0 / 32.0) + 1.0
                tail *= tail
                tail *= tail
                tail *= tail
                tail *= tail
                against = tail * math.sqrt(total) * odds + 1.0
                square = variance * variance
                squares = count_v2 * count_v2 + square
                # one division for two: w = 1 / against, g = square / squares
                each = 1.0 / (against * squares)
                w, g = squares * each, square * against * each
                nearer = g * d
                pulled = w * nearer
                fused_v2 = variance + (pulled * (nearer - pulled) + w * g * (count_v2 - variance))
                doubt = block[DOUBTED + c] + dt if w < 0.5 else 0.0
                anchor = doubt > anchor_s
                block[COUNTED + c] = soc if anchor else block[COUNTED + c]
                block[GAIN + c] = 0.0 if anchor else gain
                block[OFFSET + c] = 0.0 if anchor else offset
                block[ANCHOR + c] = anchor_factor * variance if anchor else block[ANCHOR + c]
                block[DOUBTED + c] = 0.0 if anchor else doubt
                block[APART_AT + c] = 0.0 if anchor else apart
                soc -= pulled
                variance = fused_v2
            out[SOC_AT + c] = soc
            out[SIGMA_AT + c] = math.sqrt(variance)
        for c in range(n):
            counts = out[ACCEPTED_AT + c] > 0.0
            scaled = out[INNOVATION_AT + c] * scale if counts else 0.0
            mean, square = block[MEAN + c], block[SQUARE + c]
            mean += (scaled - mean) * share if counts else 0.0
            square += (scaled * scaled - square) * share if counts else 0.0
            slow, slow_v2 = block[SLOW_AT + c], block[SLOW_V2 + c]
            slow_v2 += (slow * slow - slow_v2) * share if counts else 0.0
            slow += (scaled - slow) * slow_share if counts else 0.0
            block[MEAN + c], block[SQUARE + c] = mean, square
            block[SLOW_AT + c], block[SLOW_V2 + c] = slow, slow_v2
            out[VALID_AT + c] = 1.0 if (square < rms_v2) & (abs(mean) < bias_v) else 0.0

    return report
