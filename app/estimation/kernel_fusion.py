"""Compiled: the fusion of filter and charge count, and the self-check, for one cell.

The equations are those of `fusion` and `self_check`; tests pin both to each other.
"""

from __future__ import annotations

import math

from app.estimation.circuit import SECONDS_PER_HOUR
from app.estimation.kernel_parts import inline
from app.estimation.process import SOC_VARIANCE_MAX
from app.estimation.start import SLOPE_FLOOR_V

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg"
# ruff: noqa: ANN001, ANN201


@inline
def fuse(p, count, count_v2, soc, variance):
    """Return fused SOC, variance, and the probability that the start was right."""
    total = count_v2 + variance
    apart = soc - count
    tail = apart * apart / total * (1.0 / 32.0) + 1.0
    tail *= tail
    tail *= tail
    tail *= tail
    tail *= tail
    w = 1.0 / (tail * math.sqrt(total) * p.unknown_odds + 1.0)
    cube = variance * variance * variance
    share = cube / (count_v2 * count_v2 * count_v2 + cube)
    nearer = share * apart
    pulled = w * nearer
    return soc - pulled, variance + (pulled * (nearer - pulled) + w * share * (count_v2 - variance)), w


@inline
def finish(p, dt, moved, soc, variance, slope, innovation, used, check,
           mean, square, slow, slow_square, count, gain, offset, anchor_v2, doubt):  # fmt: skip
    """Sigma, fusion and self-check of one cell after its update; returns what is reported and what is remembered."""
    bias_v2 = p.bias_v * p.bias_v + slow_square
    variance = min(variance + bias_v2 / max(slope * slope, SLOPE_FLOOR_V * SLOPE_FLOOR_V), SOC_VARIANCE_MAX)
    if p.is_fused != 0.0:
        count -= moved
        gain += p.counter_gain * moved
        offset += (p.counter_offset_c / SECONDS_PER_HOUR) * dt
        filter_soc, filter_v2 = soc, variance
        soc, variance, w = fuse(p, count, gain * gain + offset * offset + anchor_v2, soc, variance)
        doubt = doubt + dt if w < 0.5 else 0.0
        if doubt > p.anchor_s:
            count, gain, offset, anchor_v2, doubt = filter_soc, 0.0, 0.0, filter_v2, 0.0
    if used:
        scale, weight, slow_weight = check
        scaled = innovation * scale
        mean += weight * (scaled - mean)
        square += weight * (scaled * scaled - square)
        slow += slow_weight * (scaled - slow)
        slow_square += weight * (slow * slow - slow_square)
    valid = square < p.check_rms_v * p.check_rms_v and abs(mean) < p.check_bias_v
    return soc, variance, valid, mean, square, slow, slow_square, count, gain, offset, anchor_v2, doubt
