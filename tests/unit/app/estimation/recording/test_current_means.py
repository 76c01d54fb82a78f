"""The data show whether currents are means of a second; then the voltage is taken as one too."""

import numpy as np
import pytest

from app.estimation.recording.cell_recording import clean
from app.estimation.recording.current_means import has_current_means, with_voltage_means

OHM = 0.03


def drive(seconds=1200, seed=1):
    """(n,) current [A] and voltage at 10 Hz: bursts of some seconds."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(-3.0, 15.0, seconds), rng.integers(8, 30, seconds))[: 10 * seconds]
    return current, 3.8 - OHM * current + 1e-3 * rng.normal(size=current.size)


def logged(current, volts, is_mean, gap_at=None):
    """What a logger of one row a second writes of it."""
    every = slice(9, None, 10)
    amps = current.reshape(-1, 10).mean(axis=1) if is_mean else current[every]
    time_s = np.arange(amps.size, dtype=float)
    if gap_at is not None:
        time_s[gap_at:] += 60.0
    return clean("log.csv", {"time_s": time_s, "current_a": amps, "voltage_v": volts[every]})


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("is_mean", [True, False])
def test_the_data_say_whether_currents_are_means(is_mean, seed):
    assert has_current_means(logged(*drive(seed=seed), is_mean)) == is_mean


def test_fast_rows_few_changes_and_a_voltage_that_follows_no_current_are_no_evidence():
    current, volts = drive()
    fast = clean("f", {"time_s": 0.1 * np.arange(current.size), "current_a": current, "voltage_v": volts})
    assert not has_current_means(fast)
    assert not has_current_means(logged(current[:800], volts[:800], True))
    assert not has_current_means(logged(current, 3.8 + 1e-3 * np.random.default_rng(2).normal(size=current.size), True))


def test_a_voltage_of_its_step_lies_nearer_to_what_the_mean_current_drops():
    current, volts = drive()
    log = logged(current, volts, True)
    error_v = [float(np.std(each.voltage_v + OHM * each.current_a)) for each in (with_voltage_means(log), log)]
    assert error_v[0] < 0.75 * error_v[1]


def test_nothing_is_averaged_over_a_gap_or_with_a_voltage_that_is_missing():
    log = logged(*drive(), True, gap_at=500)
    volts = log.voltage_v.copy()
    volts[100] = np.nan
    found = with_voltage_means(clean("f", {"time_s": log.time_s, "current_a": log.current_a, "voltage_v": volts}))
    assert found.voltage_v[500] == volts[500]
    assert np.isnan(found.voltage_v[100])
    assert found.voltage_v[101] == volts[101]
    assert found.voltage_v[102] == pytest.approx(0.5 * (volts[101] + volts[102]))
    assert "means" in found.notes[-1]
