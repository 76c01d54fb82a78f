import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.master.uptime_clock import UPTIME_WRAP_MS, UptimeClock

MS = 1_000_000
S = 1_000_000_000
START_NS = 77 * S


def ages_s(frames, started_ms=5000):
    """Ages of frames given as (sent [s], delay [s]), by a master whose clock is right."""
    clock = UptimeClock()
    return [
        (arrived - clock.measured_ns(round(started_ms + sent * 1000) % UPTIME_WRAP_MS, arrived)) / S
        for sent, delay in frames
        if (arrived := START_NS + round((sent + delay) * S))
    ]


def test_what_waited_longer_than_the_quickest_is_older():
    assert ages_s([(0.0, 0.004), (0.1, 0.054), (0.2, 0.004), (0.3, 1.504)]) == pytest.approx(
        [0, 0.05, 0, 1.5], abs=1e-3
    )


def test_a_growing_backlog_is_seen_whole_after_minutes():
    frames = [(k * 0.1, 0.005 + k * 0.01) for k in range(600)]
    assert ages_s(frames)[-1] == pytest.approx(5.99, abs=0.05)


def test_a_backlog_from_before_the_start_is_known_once_it_has_drained():
    frames = [(k * 0.1, 3.0) for k in range(10)] + [(1.0 + k * 0.1, 0.005) for k in range(10)] + [(2.0, 2.0)]
    assert ages_s(frames)[-1] == pytest.approx(1.995, abs=0.01)


def test_the_uptime_wraps_without_a_trace():
    frames = [(k * 0.1, 0.005) for k in range(100)] + [(10.0, 0.505)]
    found = ages_s(frames, started_ms=UPTIME_WRAP_MS - 3000)
    assert max(found[:-1]) < 0.01
    assert found[-1] == pytest.approx(0.5, abs=0.01)


def test_a_master_that_was_reset_begins_anew():
    clock = UptimeClock()
    clock.measured_ns(900_000, START_NS)
    assert clock.measured_ns(12, START_NS + S) == START_NS + S
    assert clock.measured_ns(112, START_NS + S + 400 * MS) == pytest.approx(START_NS + S + 100 * MS, abs=MS)


@pytest.mark.parametrize("rate", [1 - 100e-6, 1 + 100e-6])
def test_crystals_that_drift_apart_make_nothing_old(rate):
    clock = UptimeClock()
    ages = []
    for k in range(36_000):
        arrived = START_NS + k * 100 * MS
        ages.append(arrived - clock.measured_ns(round(k * 100 * rate), arrived))
    assert max(ages) < 5 * MS


def test_a_simulated_master_at_half_the_speed_is_not_late_where_its_port_is_read_empty():
    clock = UptimeClock()
    ages = []
    for k in range(600):
        arrived = START_NS + k * 200 * MS
        ages.append(arrived - clock.measured_ns(k * 100, arrived, waited_max_ns=30 * MS))
    assert max(ages) <= 30 * MS


@given(
    st.lists(
        st.tuples(st.integers(0, UPTIME_WRAP_MS - 1), st.integers(0, 10 * S), st.none() | st.integers(0, S)), min_size=1
    )
)
def test_whatever_uptimes_come_nothing_is_measured_after_it_arrived(frames):
    clock, now = UptimeClock(), START_NS
    for uptime, step, waited in frames:
        now += step
        measured = clock.measured_ns(uptime, now, waited)
        assert measured <= now
        assert waited is None or now - measured <= waited


def of_a_running_master(steps):
    """Frames so many milliseconds of its clock apart, over the end of the clock."""
    uptimes = UPTIME_WRAP_MS - 1000 + np.cumsum([step for step, _ in steps], dtype=np.int64)
    return [(uptime % UPTIME_WRAP_MS, passed) for uptime, (_, passed) in zip(uptimes.tolist(), steps, strict=True)]


@pytest.mark.parametrize(
    "any_frames",
    [
        st.lists(st.tuples(st.integers(0, UPTIME_WRAP_MS - 1) | st.integers(0, 3000), st.integers(-20 * MS, 40 * S))),
        st.lists(st.tuples(st.integers(0, 200), st.integers(0, 300 * MS)), max_size=40).map(of_a_running_master),
    ],
    ids=["any", "of a running master"],
)
@given(data=st.data(), cut=st.integers(0, 5))
def test_frames_taken_together_are_measured_as_one_by_one(any_frames, data, cut):
    frames = data.draw(any_frames)
    uptimes = np.array([uptime for uptime, _ in frames], np.int64)
    arrived = START_NS + np.cumsum(np.array([passed for _, passed in frames], np.int64))
    one, together = UptimeClock(), UptimeClock()
    singly = [one.measured_ns(*frame) for frame in zip(uptimes.tolist(), arrived.tolist(), strict=True)]
    halves = [together.all_measured_ns(uptimes[part], arrived[part]) for part in (slice(cut), slice(cut, None))]
    assert np.concatenate(halves).tolist() == singly
