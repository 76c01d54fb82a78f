"""Time from the violation to the open circuit, out of samples at the master; each end lies between two samples.

Both ends stand on the master's own clock, so that neither the line nor this computer can make the time shorter: a frame
that comes late still says when it was copied, one that is lost only moves two samples apart. This computer's clock is
held against the master's, and where the two run at different rates the band is widened by it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from app.analysis.evidence.master_samples import MasterSample, SampledValues
from app.analysis.evidence.steps import Cycles, Sign
from firmware_protocol.config_image import to_unit
from firmware_protocol.memory_map import CONFIG, T_MISSING, V_MISSING
from firmware_protocol.messages import EventCode

UPTIME_STEP_S: Final = 0.001  # resolution of the master's clock
MIN_SPAN_S: Final = 2.0  # over less the two clocks say nothing of each other
TRIPS: Final = frozenset(code for code in EventCode if code.name.startswith("TRIP_"))
Mask = NDArray[np.bool_]
Missing = Literal["no-frames", "violated-before", "not-seen", "not-opened", "restarted"]


@dataclass(frozen=True, slots=True)
class ConfiguredLimits:
    """The limits in force, in the counts of the memory map."""

    v_cell_min: int
    v_cell_max: int
    t_cell_min: int
    t_cell_max: int
    i_disc_min: int
    i_disc_max: int
    v_alpha: int
    ts: int
    fc_avg: int

    @classmethod
    def of(cls, image: bytes) -> ConfiguredLimits:
        """Return those of a configuration's 420 bytes."""
        return cls(*(CONFIG[name].unpack(image)[0] for name in cls.__slots__))


@dataclass(frozen=True, slots=True)
class ClockRate:
    """Seconds of this computer in one of the master's, and how far that may be off."""

    rate: float
    uncertainty: float
    latest_s: float  # the latest frame came so much after what the quickest one took

    def longest(self, seconds: float) -> float:
        """Return the longest that a time on the master's clock may have been."""
        return seconds * max(1.0, self.rate + self.uncertainty)

    def shortest(self, seconds: float) -> float:
        """Return the shortest."""
        return seconds * min(1.0, self.rate - self.uncertainty)


@dataclass(frozen=True, slots=True)
class Timing:
    """A reaction time as a band [s], and what makes the band wide [s]."""

    low_s: float
    high_s: float
    sampled_s: float  # between the last sample within the limits and the first beyond
    opened_s: float  # between the last sample at a closed circuit and the first at an open one
    latency_s: float  # delay of the firmware's own measuring and filter
    clock_s: float  # uncertainty of the two clocks
    host_s: float  # from the first sample beyond to the open one by this computer's clock, the line's time taken off
    cell: int | None
    value: float | None  # in the field's unit
    limit: float | None
    trip: int | None  # code that the master gave


@dataclass(frozen=True, slots=True)
class Unmeasured:
    """The reason for a missing reaction time."""

    why: Missing


def clock_rate(samples: Sequence[MasterSample]) -> ClockRate:
    """Hold this computer's clock against the master's, by the frames that waited least at both ends of a recording."""
    if len(samples) < 2 or samples[-1].uptime_ms - samples[0].uptime_ms < MIN_SPAN_S * 1000:
        return ClockRate(1.0, 0.0, 0.0)
    uptime_s = np.array([sample.uptime_ms - samples[0].uptime_ms for sample in samples]) * 1e-3
    arrived_s = np.array([sample.arrived_ns - samples[0].arrived_ns for sample in samples]) * 1e-9
    late_s = arrived_s - np.array([sample.line_s for sample in samples]) - uptime_s
    quarter_s = uptime_s[-1] / 4
    ends = [np.flatnonzero(uptime_s <= quarter_s), np.flatnonzero(uptime_s >= uptime_s[-1] - quarter_s)]
    first, last = (end[late_s[end].argmin()] for end in ends)
    span_s = float(uptime_s[last] - uptime_s[first])
    uncertainty_s = sum(float(np.median(late_s[end]) - late_s[end].min()) for end in ends) + 2 * UPTIME_STEP_S
    drift_s = float(late_s[last] - late_s[first])
    left_s = late_s - late_s[first] - (uptime_s - uptime_s[first]) * drift_s / span_s
    return ClockRate(1 + drift_s / span_s, uncertainty_s / span_s, float(left_s.max()))


def measure(
    samples: Sequence[MasterSample], sign: Sign, limits: ConfiguredLimits, cycles: Cycles, rate: ClockRate
) -> Timing | Unmeasured:
    """Return how long the master took from the first violation to the open circuit.

    The violation began after the last sample within the limits, less the latency of the firmware, and before the first
    sample beyond. The circuit opened after the last sample of a closed one and before the first of an open one; a
    trip's event leaves ahead of all telemetry, so the frame before it is such a sample too (SPEC section 8, rule 1).

    Args:
        samples: from before the fault to after the circuit opened, in order of arrival.
        sign: what the fault shows.
        limits: in force.
        cycles: of the firmware.
        rate: of the clocks.
    """
    fast = [sample for sample in samples if sample.values is not None]
    if not fast:
        return Unmeasured("no-frames")
    if any(sample.boot != samples[0].boot for sample in samples):
        return Unmeasured("restarted")
    shows = _sign(sign, limits, _values(fast[0]))
    if not _values(fast[0]).is_ok or shows(_values(fast[0])) is not None:
        return Unmeasured("violated-before")
    from_s = samples[samples.index(fast[0]) + 1 :]
    opened = next((sample for sample in from_s if _is_open(sample)), None)
    bad = next((i for i, sample in enumerate(fast) if shows(_values(sample)) is not None), None)
    if opened is None:
        return Unmeasured("not-seen" if bad is None else "not-opened")
    if bad is None or fast[bad].uptime_ms > opened.uptime_ms:
        return Unmeasured("not-seen")
    before, first = fast[bad - 1], fast[bad]
    cell = shows(_values(first))
    closed_ms = _last_closed_ms(samples, opened)
    latency_s = _latency_s(sign, limits, cycles, fast[bad - 1 :], cell)
    high_s = (opened.uptime_ms - before.uptime_ms) * 1e-3 + latency_s + UPTIME_STEP_S
    low_s = max(0.0, (closed_ms - first.uptime_ms) * 1e-3 - UPTIME_STEP_S)
    trips = [sample.event for sample in samples if sample.event is not None and sample.event.code in TRIPS]
    value, limit = _figures(sign, limits, _values(first), cell)
    return Timing(
        low_s=rate.shortest(low_s),
        high_s=rate.longest(high_s),
        sampled_s=(first.uptime_ms - before.uptime_ms) * 1e-3,
        opened_s=(opened.uptime_ms - closed_ms) * 1e-3,
        latency_s=latency_s,
        clock_s=2 * UPTIME_STEP_S + rate.longest(high_s) - high_s + low_s - rate.shortest(low_s),
        host_s=(opened.arrived_ns - first.arrived_ns) * 1e-9 - opened.line_s + first.line_s,
        cell=cell if cell is not None and cell >= 0 else None,
        value=value,
        limit=limit,
        trip=trips[0].code if trips else None,
    )


def _values(sample: MasterSample) -> SampledValues:
    if sample.values is None:
        raise ValueError("no fast frame")
    return sample.values


def _is_open(sample: MasterSample) -> bool:
    if sample.values is not None:
        return not sample.values.is_ok
    return sample.event is not None and sample.event.code in TRIPS


def _last_closed_ms(samples: Sequence[MasterSample], opened: MasterSample) -> int:
    at = next(i for i, sample in enumerate(samples) if sample is opened)
    closed = [sample.uptime_ms for sample in samples[:at] if sample.values is not None and sample.values.is_ok]
    previous = samples[at - 1]
    if opened.event is not None and (previous.sequence + 1) & 0xFF == opened.sequence:
        closed.append(previous.uptime_ms)
    return max(closed)


def _sign(sign: Sign, limits: ConfiguredLimits, healthy: SampledValues) -> Callable[[SampledValues], int | None]:
    """Return what finds the violation: the first cell that shows it, -1 where it is no cell's, None without one."""

    def cells(beyond: Callable[[SampledValues], Mask]) -> Callable[[SampledValues], int | None]:
        def find(values: SampledValues) -> int | None:
            indices = np.flatnonzero(beyond(values))
            return int(indices[0]) if len(indices) else None

        return find

    def whole(beyond: Callable[[SampledValues], bool]) -> Callable[[SampledValues], int | None]:
        return lambda values: -1 if beyond(values) else None

    had_voltage, had_temperature = healthy.voltage != V_MISSING, healthy.temperature != T_MISSING

    def high(v: SampledValues) -> Mask:
        return np.greater(v.voltage, limits.v_cell_max)

    def low(v: SampledValues) -> Mask:
        is_low: Mask = (v.voltage < limits.v_cell_min) & (v.voltage != V_MISSING)
        return is_low

    def hot(v: SampledValues) -> Mask:
        return np.greater(v.temperature, limits.t_cell_max)

    def cold(v: SampledValues) -> Mask:
        is_cold: Mask = (v.temperature < limits.t_cell_min) & (v.temperature != T_MISSING)
        return is_cold

    match sign:
        case "voltage-high":
            return cells(high)
        case "voltage-low":
            return cells(low)
        case "temperature-high":
            return cells(hot)
        case "temperature-low":
            return cells(cold)
        case "wire-lost" | "slave-lost":  # an input without its wire may float anywhere before it is found
            return cells(lambda v: ((v.voltage == V_MISSING) & had_voltage) | high(v) | low(v))
        case "temperature-lost":
            return cells(lambda v: ((v.temperature == T_MISSING) & had_temperature) | hot(v) | cold(v))
        case "current-high":
            return whole(lambda v: max(v.current) > limits.i_disc_max)
        case "current-low":
            return whole(lambda v: min(v.current) < limits.i_disc_min)
        case "current-lost":
            return whole(lambda v: max(v.current) > limits.i_disc_max or min(v.current) < limits.i_disc_min)


def _latency_s(
    sign: Sign, limits: ConfiguredLimits, cycles: Cycles, samples: Sequence[MasterSample], cell: int | None
) -> float:
    """Return how long a violation may have stood before the master's struct shows it [s]."""
    if sign.startswith("temperature"):
        return cycles.temperature_s + cycles.pass_s
    if sign.startswith("current"):
        averaged = max(math.ceil(limits.fc_avg / limits.ts), 1) * limits.ts  # whole buffers of samples of 1 ms
        return cycles.pass_s + (averaged + limits.ts) * 1e-3  # a violation begins anywhere in the first of them
    if sign == "wire-lost":
        return cycles.wire_check_s + cycles.pass_s
    if sign == "slave-lost" or cell is None:
        return cycles.pass_s
    traced = [int(_values(sample).voltage[cell]) for sample in samples]
    limit = limits.v_cell_max if sign == "voltage-high" else limits.v_cell_min
    extreme = max(traced) if sign == "voltage-high" else min(v for v in traced if v != V_MISSING)
    return cycles.pass_s * _filter_passes(traced[0], extreme, limit, limits.v_alpha / 1000)


def _filter_passes(before: float, after: float, limit: float, alpha: float) -> int:
    """Return the passes after which v' = v + alpha (sample - v) has gone beyond a limit; the sample steps at the first.

    after n passes: v = after - (after - before) (1 - alpha)^n
    """
    left = (after - limit) / (after - before) if after != before else 1.0
    if alpha >= 1 or left >= 1:
        return 1
    return max(1, math.floor(math.log(max(left, 1e-6)) / math.log1p(-alpha)) + 1)


def _figures(
    sign: Sign, limits: ConfiguredLimits, values: SampledValues, cell: int | None
) -> tuple[float | None, float | None]:
    """Return the value that violated and its limit, in units."""
    if sign.startswith("current"):
        counts = max(values.current, key=abs)
        name = "i_disc_max" if counts > 0 else "i_disc_min"
        limit = None if sign == "current-lost" else to_unit(CONFIG[name], getattr(limits, name))
        return counts * CONFIG[name].scale, limit
    at = cell or 0
    if sign in ("wire-lost", "slave-lost", "temperature-lost"):
        return None, None
    name = {
        "voltage-high": "v_cell_max",
        "voltage-low": "v_cell_min",
        "temperature-high": "t_cell_max",
        "temperature-low": "t_cell_min",
    }[sign]
    counts = int((values.voltage if sign.startswith("voltage") else values.temperature)[at])
    return to_unit(CONFIG[name], counts), to_unit(CONFIG[name], getattr(limits, name))
