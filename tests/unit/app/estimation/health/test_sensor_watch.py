import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.health.sensor_watch import ChannelWatch, ThermistorWatch

N, PER_PACK = 24, 12
NAN = float("nan")


def warm(seconds, shown=None, rate_k=0.02):
    """Warm both packs by `rate_k` a second, seen to a degree; `shown(t, degc)` spoils what a sensor shows."""
    watch = ThermistorWatch(N, PER_PACK)
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


def test_sound_thermistors_are_left_alone():
    assert not warm(900).is_dead.any()


def test_a_thermistor_that_jumps_came_off():
    found = warm(120, put(5, 80.0))
    assert np.flatnonzero(found.is_dead).tolist() == [5]
    assert found.size[5] > 50
    assert 58 <= found.since_s[5] <= 64


def test_a_thermistor_without_a_value_is_found_while_its_pack_has_values():
    found = warm(120, put(5, NAN))
    assert np.flatnonzero(found.is_dead).tolist() == [5]
    assert np.isnan(found.size[5])


def test_a_thermistor_that_shows_one_value_while_its_pack_warms_is_stuck():
    found = warm(600, put(5, 26.0))
    assert np.flatnonzero(found.is_dead).tolist() == [5]


def test_a_pack_without_values_is_no_matter_of_its_thermistors():
    assert not warm(120, put(slice(0, 12), NAN)).is_dead.any()


def test_a_thermistor_that_shows_its_cell_again_is_sound():
    assert not warm(200, put(5, 80.0, 60, 100)).is_dead.any()


def test_a_cell_that_really_heats_is_no_broken_sensor():
    def heats(k, degc):
        degc[5] += 0.15 * max(k - 60, 0)  # 70 W into one cell

    assert not warm(300, heats).is_dead.any()


def drive(shown=None, seconds=60, current=None, noise_v=2e-4):
    watch, rng = ChannelWatch(N, PER_PACK), np.random.default_rng(3)
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


def test_a_channel_that_stands_still_while_the_others_move_is_stuck():
    found = drive(put(7, 3.7, 20))
    assert np.flatnonzero(found.is_dead).tolist() == [7]
    assert found.value[7] == 3.7


def test_a_channel_that_hops_while_no_current_flows_is_not_its_cell():
    assert np.flatnonzero(drive(put(7, 3.2, 20), current=0.0).is_dead).tolist() == [7]


def test_a_missing_voltage_is_found_after_some_seconds_and_ends_with_its_return():
    assert np.flatnonzero(drive(put(7, NAN, 20)).is_dead).tolist() == [7]
    assert not drive(put(7, NAN, 20, 30)).is_dead.any()


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-200, 200, allow_nan=False), min_size=2, max_size=12))
def test_no_sequence_of_currents_makes_a_sound_channel_stuck(currents):
    watch, rng = ChannelWatch(N, PER_PACK), np.random.default_rng(1)
    resistance_ohm = 2e-3 * (1 + 0.1 * rng.normal(size=N))
    for k in range(200):
        current_a = currents[k // 10 % len(currents)]
        watch.step(0.2 * k, 0.2, current_a, 3.7 - resistance_ohm * current_a + rng.normal(0, 1e-4, N))
    assert not watch.result().is_dead.any()
