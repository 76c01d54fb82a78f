import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.health.packs import Packs
from app.estimation.health.sensor_watch import ChannelWatch, ThermistorWatch
from tests.campaign import examples

N, PER_PACK = 24, 12
SEGMENTS = Packs((PER_PACK,) * (N // PER_PACK))
NAN = float("nan")


def warm(seconds, shown=None, rate_k=0.02):
    """Warm both packs by `rate_k` a second, seen to a degree; `shown(t, degc)` spoils what a sensor shows."""
    watch = ThermistorWatch(SEGMENTS)
    apart = np.linspace(-1.5, 1.5, N)
    for k in range(seconds):
        degc = np.round(25.0 + rate_k * k + apart)
        if shown is not None:
            shown(k, degc)
        watch.step(float(k), 1.0, degc)
    return watch.result()


def put(cell, value, from_s=60, to_s=10**6):
    def shown(k, degc):
        if from_s <= k < to_s:
            degc[cell] = value

    return shown


def heats(k, degc):
    degc[5] += 0.15 * max(k - 60, 0)  # 70 W into one cell


def two_packs(k, degc):
    degc[:12] += 20.0


@pytest.mark.parametrize("shown", [heats, two_packs, put(slice(0, 12), NAN), put(5, 80.0, 60, 100)])
def test_a_cell_that_heats_a_warm_or_silent_pack_and_a_sensor_that_is_well_again_are_no_fault(shown):
    assert not warm(300, shown).is_dead.any()


def test_a_thermistor_that_shows_one_value_while_its_pack_warms_is_stuck():
    found = warm(600, put(5, 26.0))
    assert np.flatnonzero(found.is_dead).tolist() == [5]


def drive(shown=None, seconds=60, current=None, noise_v=2e-4):
    watch, rng = ChannelWatch(SEGMENTS), np.random.default_rng(3)
    for k in range(seconds * 5):
        current_a = (60.0 + 50.0 * np.sin(k / 9.0)) if current is None else current
        v = 3.9 - 2e-3 * current_a - 1e-5 * k + rng.normal(0, noise_v, N)
        if shown is not None:
            shown(k / 5, v)
        watch.step(k / 5, 0.2, current_a, v)
    return watch.result()


def test_sound_channels_are_left_alone():
    assert not drive().is_dead.any()
    assert not drive(current=0.0).is_dead.any()
    assert not drive(noise_v=0.02).is_dead.any()


def test_a_channel_that_hops_while_no_current_flows_is_not_its_cell():
    assert np.flatnonzero(drive(put(7, 3.2, 20), current=0.0).is_dead).tolist() == [7]


def test_a_missing_voltage_is_found_after_some_seconds_and_ends_with_its_return():
    assert np.flatnonzero(drive(put(7, NAN, 20)).is_dead).tolist() == [7]
    assert not drive(put(7, NAN, 20, 30)).is_dead.any()


@settings(max_examples=examples(25), deadline=None)
@given(st.lists(st.floats(-200, 200, allow_nan=False), min_size=2, max_size=12))
def test_no_sequence_of_currents_makes_a_sound_channel_stuck(currents):
    watch, rng = ChannelWatch(SEGMENTS), np.random.default_rng(1)
    resistance_ohm = 2e-3 * (1 + 0.1 * rng.normal(size=N))
    for k in range(200):
        current_a = currents[k // 10 % len(currents)]
        watch.step(0.2 * k, 0.2, current_a, 3.7 - resistance_ohm * current_a + rng.normal(0, 1e-4, N))
    assert not watch.result().is_dead.any()


SHAPES = [(14, 14), (216, 18), (96, 12)]
shapes_and_cells = st.sampled_from(SHAPES).flatmap(
    lambda shape: st.tuples(st.just(shape), st.integers(0, shape[0] - 1))
)


@settings(max_examples=examples(15), deadline=None)
@given(shapes_and_cells, st.sampled_from([-40.0, 85.0, 125.0, NAN]))
def test_a_thermistor_that_came_off_is_named_in_any_pack_and_no_other(placed, shown_degc):
    (n, per_pack), cell = placed
    watch = ThermistorWatch(Packs((per_pack,) * (n // per_pack)))
    for k in range(60):
        degc = np.round(30.0 + 0.02 * k + np.linspace(-2.0, 2.0, n))
        if k >= 20:
            degc[cell] = shown_degc
        watch.step(float(k), 1.0, degc)
    found = watch.result()
    assert np.flatnonzero(found.is_dead).tolist() == [cell]
    assert found.usual[cell] == pytest.approx(30.0, abs=4.0)


@settings(max_examples=examples(15), deadline=None)
@given(shapes_and_cells, st.integers(0, 10**6))
def test_a_channel_that_stands_still_is_named_in_any_pack_and_no_other(placed, seed):
    (n, per_pack), cell = placed
    watch, rng, stuck_v = ChannelWatch(Packs((per_pack,) * (n // per_pack))), np.random.default_rng(seed), NAN
    for k in range(150):
        current_a = 60.0 + 50.0 * np.sin(k / 9.0)
        v = 3.9 - 2e-3 * current_a + rng.normal(0, 2e-4, n)
        if k == 50:
            stuck_v = v[cell]
        if k >= 50:
            v[cell] = stuck_v
        watch.step(0.2 * k, 0.2, current_a, v)
    found = watch.result()
    assert np.flatnonzero(found.is_dead).tolist() == [cell]
    assert found.since_s[cell] >= 9.0
    assert found.size[cell] >= 30e-3


@settings(max_examples=examples(15), deadline=None)
@given(st.integers(0, 10**6), st.floats(-0.05, 0.05))
def test_no_noise_of_sound_thermistors_is_a_finding(seed, rate_k):
    watch, rng = ThermistorWatch(SEGMENTS), np.random.default_rng(seed)
    own = rng.normal(0, 1.0, N)
    for k in range(300):
        watch.step(float(k), 1.0, np.round(30.0 + rate_k * k + own + rng.normal(0, 0.3, N)))
    assert not watch.result().is_dead.any()


def test_after_a_hole_a_thermistor_is_compared_with_its_pack_as_it_is_then():
    watch = ThermistorWatch(SEGMENTS)
    for k in range(30):
        watch.step(float(k), 1.0, np.full(N, 25.0))
    later = np.where(np.arange(N) == 5, 36.0, 25.0)  # a cell that was driven hard meanwhile
    for k in range(30):
        watch.step(3600.0 + k, 3570.0 if k == 0 else 1.0, later)
    assert not watch.result().is_dead.any()


@pytest.mark.parametrize("jump_s", [-1e5, 1e9])
def test_a_clock_that_is_set_makes_no_sensor_dead(jump_s):
    thermistors, channels, rng = ThermistorWatch(SEGMENTS), ChannelWatch(SEGMENTS), np.random.default_rng(2)
    for k in range(120):
        time_s = k + (jump_s if k >= 60 else 0.0)
        current_a = float(rng.choice([0.0, 60.0]))
        thermistors.step(time_s, 1.0, np.full(N, 25.0))
        channels.step(time_s, 1.0, current_a, 3.7 - 2e-3 * current_a + rng.normal(0, 2e-4, N))
    assert not thermistors.result().is_dead.any()
    assert not channels.result().is_dead.any()


def test_no_channel_of_a_silent_battery_is_stuck():
    watch = ChannelWatch(SEGMENTS)
    for k in range(100):
        watch.step(0.2 * k, 0.2, NAN, np.full(N, NAN))
    assert not watch.result().is_dead.any()


def test_a_slave_that_is_missing_is_no_fault_of_its_channels():
    assert not drive(put(slice(0, 12), NAN, 20)).is_dead.any()


def test_a_stuck_channel_stays_dead_while_the_car_stands_and_is_sound_once_it_follows():
    watch, rng, told = ChannelWatch(SEGMENTS), np.random.default_rng(3), []
    for k in range(900):
        current_a = 0.0 if 300 <= k < 600 else 60.0 + 50.0 * np.sin(k / 9.0)
        v = 3.9 - 2e-3 * current_a + rng.normal(0, 2e-4, N)
        if k < 600:
            v[7] = 3.7
        watch.step(0.2 * k, 0.2, current_a, v)
        told.append(bool(watch.is_dead[7]))
    assert told[299]
    assert told[590]
    assert not told[-1]
