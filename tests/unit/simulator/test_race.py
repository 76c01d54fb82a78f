"""The race against the public statistics of 60 to 80 kW cars over 22 km."""

import numpy as np
import pytest

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.loads import LoadState, Phase
from simulator.race import SAMPLE_S, Event, acceleration, endurance, skid_pad

KWH = 3.6e6


@pytest.fixture(scope="module", params=[1, 7])
def race(request) -> Event:
    return endurance(np.random.default_rng(request.param))


def states(event: Event) -> list[LoadState]:
    return [event.state(t) for t in np.arange(0.0, event.duration_s, 0.5)]


def driving(event: Event) -> np.ndarray:
    return event.power_w[event.speed_m_per_s > 0.0]


def test_a_seed_repeats_the_race_and_another_does_not():
    first, again, other = (endurance(np.random.default_rng(seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.power_w, again.power_w)
    assert len(first.power_w) != len(other.power_w)


def test_it_is_22_km_in_22_laps_of_about_a_minute(race):
    laps = {state.lap for state in states(race) if state.phase is Phase.DRIVING}
    assert laps == set(range(1, 23))
    assert race.speed_m_per_s.sum() * SAMPLE_S == pytest.approx(22_000.0, rel=0.02)
    driven_s = (race.speed_m_per_s > 0.0).sum() * SAMPLE_S
    assert 57.0 < driven_s / 22 < 67.0


def test_drivers_change_for_three_minutes_with_high_voltage_off_after_eleven_laps(race):
    pause = [state for state in states(race) if state.phase is Phase.DRIVER_CHANGE]
    assert len(pause) * 0.5 == pytest.approx(180.0, abs=1.0)
    assert {state.lap for state in pause} == {11}
    assert not any(state.is_high_voltage_on for state in pause)


def test_a_car_has_come_to_rest_before_high_voltage_goes_off(race):
    is_on = np.array([race.state(k * SAMPLE_S).is_high_voltage_on for k in range(len(race.power_w))])
    off = np.flatnonzero(is_on[:-1] & ~is_on[1:]) + 1
    assert off.size
    for row in off:
        assert np.abs(race.power_w[row - round(1.0 / SAMPLE_S) : row]).max() < 1e3


def test_energy_and_power_are_those_of_the_results_lists(race):
    net_kwh = race.power_w.sum() * SAMPLE_S / KWH
    assert 5.0 < net_kwh < 7.2
    power = driving(race)
    assert 13e3 < power.mean() < 19e3
    assert 3.0 < power.max() / power.mean() < 5.0
    assert 0.03 < -power[power < 0].sum() / power[power > 0].sum() < 0.2


def test_throttle_comes_in_bursts_of_a_second_or_two(race):
    is_burst = np.concatenate(([False], driving(race) > 10e3, [False]))
    edges = np.flatnonzero(np.diff(is_burst.astype(int)))
    lengths_s = (edges[1::2] - edges[::2]) * SAMPLE_S
    assert 8 < len(lengths_s) / 22 < 20
    assert 0.8 < np.median(lengths_s) < 2.2
    assert lengths_s.max() < 6.0


def test_the_pack_ends_the_race_with_charge_left_and_within_its_limits():
    event = endurance(np.random.default_rng(2))
    accumulator = Accumulator(AccumulatorParameters(start_soc=0.95, ambient_degc=22.0), np.random.default_rng(0))
    lowest_v, highest_a = 5.0, 0.0
    for t in np.arange(0.0, event.duration_s, 0.1):
        current_a = event.current_a(float(t), accumulator)
        accumulator.step(0.1, current_a, fan_duty=0.6)
        lowest_v = min(lowest_v, float(accumulator.terminal_voltage_v.min()))
        highest_a = max(highest_a, current_a)
    assert 0.18 < accumulator.soc.min() < 0.40
    assert lowest_v > 2.8
    assert highest_a <= 180.0
    assert 32.0 < accumulator.temperature_degc.max() < 45.0


def test_before_and_after_the_race_nothing_flows(race):
    accumulator = Accumulator(AccumulatorParameters(), np.random.default_rng(0))
    assert race.current_a(-1.0, accumulator) == 0.0
    assert race.current_a(race.duration_s + 1.0, accumulator) == 0.0
    assert race.state(race.duration_s + 1.0).phase is Phase.FINISHED
    assert race.state(0.0).phase is Phase.STANDBY


def test_acceleration_is_75_m_in_four_seconds_at_full_power():
    event = acceleration()
    first_run = [state for state in states(event) if state.phase is Phase.DRIVING and state.lap == 1]
    assert 3.0 < len(first_run) * 0.5 < 5.5
    assert event.power_w.max() > 70e3


def test_skid_pad_is_steady():
    event = skid_pad()
    running = event.power_w[event.speed_m_per_s > 9.0]
    circle_s = 2 * np.pi * 9.125 / np.median(event.speed_m_per_s[event.speed_m_per_s > 0.0])
    assert 4.5 < circle_s < 6.0
    assert 3e3 < np.median(running) < 20e3
