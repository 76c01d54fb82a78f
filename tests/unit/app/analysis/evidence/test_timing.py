"""The outside judge of reaction times: the simulation's own truth lies inside the band, whatever befalls the bytes."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.analysis.evidence.master_samples import master_samples
from app.analysis.evidence.steps import STEPS, Cycles
from app.analysis.evidence.timing import ConfiguredLimits, Timing, Unmeasured, clock_rate, measure
from firmware_protocol.framing import BAUD_RATE, Frame, decode_chunk, encode_frame
from tests.campaign import examples, of_size
from tests.reaction import CELL, FAULTS_OF_STEPS, Car

NAMES = [step.name for step in STEPS]
HARDEST = ["voltage-high", "temperature-high", "slave-lost"]


@cache
def driven(seed, names, ts_ms=40, clock_rate=1.0):
    """All frames of a car, the rate of its clock, its limits, and of each step its truth and frames."""
    car = Car(seed, ts_ms=ts_ms, clock_rate=clock_rate)
    reactions = {name: car.react(name) for name in names}
    return car.frames, rate_of(car.frames), ConfiguredLimits.of(car.config), reactions


def rate_of(frames):
    return clock_rate(master_samples(frames, BAUD_RATE))


def measured(name, part, rate, limits):
    return measure(master_samples(part, BAUD_RATE), name, limits, Cycles(), rate)


@pytest.mark.parametrize("seed", range(of_size(1, 2, 4, 8)))
@pytest.mark.parametrize("ts_ms", [40, 100])
def test_the_truth_lies_inside_the_band_of_every_step(seed, ts_ms):
    _frames, rate, limits, reactions = driven(seed, tuple(NAMES), ts_ms)
    for name, (truth_s, part) in reactions.items():
        timing = measured(name, part, rate, limits)
        assert isinstance(timing, Timing), name
        assert timing.low_s <= truth_s <= timing.high_s, name
        assert timing.high_s - timing.low_s < timing.sampled_s + timing.opened_s + timing.latency_s + 0.02


@pytest.mark.parametrize("clock_rate", [0.97, 0.999, 1.001, 1.03][:: of_size(3, 1, 1)])
def test_a_master_whose_clock_runs_wrong_does_not_look_quicker(clock_rate):
    """The truth is counted by the host's clock here: the master counts its 300 ms too slowly or too fast."""
    _frames, rate, limits, reactions = driven(11, tuple(HARDEST), clock_rate=clock_rate)
    for name, (truth_s, part) in reactions.items():
        timing = measured(name, part, rate, limits)
        assert timing.low_s <= truth_s * clock_rate <= timing.high_s


@settings(max_examples=examples(60), deadline=None)
@given(st.sampled_from(HARDEST), st.floats(0, 0.7), st.integers(0, 2**32 - 1))
def test_lost_frames_only_widen_the_band(name, share, seed):
    _frames, rate, limits, reactions = driven(11, tuple(HARDEST))
    truth_s, part = reactions[name]
    kept = np.random.default_rng(seed).random(len(part)) >= share
    timing = measured(name, [each for each, is_kept in zip(part, kept, strict=True) if is_kept], rate, limits)
    assert isinstance(timing, Unmeasured) or timing.low_s <= truth_s <= timing.high_s


@settings(max_examples=examples(60), deadline=None)
@given(st.sampled_from(HARDEST), st.floats(0, 2), st.integers(-(10**15), 10**15), st.integers(0, 2**32 - 1))
def test_late_frames_and_shifted_clocks_do_not_make_it_shorter(name, late_s, shift_ns, seed):
    frames, _rate, limits, reactions = driven(11, tuple(HARDEST))
    truth_s, part = reactions[name]
    waits_ns = np.random.default_rng(seed).exponential(late_s * 1e9, len(frames)).astype(np.int64)
    arrived = np.maximum.accumulate([at_ns + int(wait) for (at_ns, _), wait in zip(frames, waits_ns, strict=True)])
    late = [(int(at_ns) + shift_ns, raw) for at_ns, (_, raw) in zip(arrived, frames, strict=True)]
    first = frames.index(part[0])
    timing = measured(name, late[first : first + len(part)], rate_of(late), limits)
    assert timing.low_s <= truth_s <= timing.high_s


@pytest.mark.parametrize("offset_ms", [0, 12_345, 2**32 - 700])
def test_where_the_masters_clock_stands_changes_nothing(offset_ms):
    _frames, rate, limits, reactions = driven(11, tuple(HARDEST))

    def moved(part):
        found = [(at_ns, decode_chunk(raw)) for at_ns, raw in part]
        first_ms = next(frame.uptime_ms for _, frame in found if isinstance(frame, Frame))
        return [
            (at_ns, encode_frame(f.type, f.sequence, f.uptime_ms - first_ms + offset_ms, f.body)[1:-1])
            for at_ns, f in found
        ]

    truth_s, part = reactions["voltage-high"]
    timing = measured("voltage-high", moved(part), rate, limits)
    assert timing.low_s <= truth_s <= timing.high_s
    assert timing.cell == CELL


def test_what_cannot_be_measured_says_why():
    _frames, rate, limits, reactions = driven(11, tuple(HARDEST))
    _, part = reactions["voltage-high"]
    assert measured("voltage-high", [], rate, limits) == Unmeasured("no-frames")
    assert measured("voltage-low", part[:6], rate, limits) == Unmeasured("not-seen")
    assert measured("temperature-high", part, rate, limits) == Unmeasured("not-seen")  # it opened for another reason
    late = measured("voltage-high", part[12:], rate, limits)
    assert late == Unmeasured("violated-before")
    opened = next(i for i, each in enumerate(master_samples(part, BAUD_RATE)) if each.values and not each.values.is_ok)
    assert measured("voltage-high", part[: opened - 2], rate, limits) == Unmeasured("not-opened")


def test_every_step_has_a_fault_in_the_judge():
    assert set(FAULTS_OF_STEPS) == set(NAMES)
