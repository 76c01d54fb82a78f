import numpy as np
import pytest

from simulator.sensors import (
    ADC_MAX,
    AMPERES_PER_COUNT,
    CELL_ERROR_LIMIT_V,
    UNPLUGGED_A,
    ZERO_COUNT,
    CellInputs,
    CurrentSensor,
    NoisePool,
)


def current_sensor(seed: int = 1) -> CurrentSensor:
    rng = np.random.default_rng(seed)
    return CurrentSensor(rng, NoisePool(rng))


def amperes(counts: np.ndarray) -> float:
    return float(counts.mean() - ZERO_COUNT) * AMPERES_PER_COUNT


@pytest.mark.parametrize("seed", range(5))
def test_current_is_within_one_percent_and_one_ampere(seed):
    sensor = current_sensor(seed)
    for true_a in (-150.0, 0.0, 200.0):
        assert abs(amperes(sensor.sample(true_a, 1000)) - true_a) < 1.0 + 0.01 * abs(true_a)


def test_current_noise_is_a_sixth_of_an_ampere():
    counts = current_sensor().sample(0.0, 5000)
    assert 0.1 < counts.std() * AMPERES_PER_COUNT < 0.25
    assert np.array_equal(counts, np.rint(counts))


def test_converter_saturates_at_its_rails():
    sensor = current_sensor()
    assert set(sensor.sample(2000.0, 20)) == {ADC_MAX}
    assert set(sensor.sample(-2000.0, 20)) == {0}


def test_unplugged_sensor_reads_as_308_ampere_whatever_flows():
    sensor = current_sensor()
    sensor.is_unplugged = True
    assert amperes(sensor.sample(-50.0, 1000)) == pytest.approx(UNPLUGGED_A, abs=0.3)


def test_voltage_error_is_fixed_per_channel_and_within_the_data_sheet():
    rng = np.random.default_rng(3)
    inputs = CellInputs(96, rng, NoisePool(rng))
    error_v = np.mean([inputs.read(np.full(96, 3.7)) for _ in range(400)], axis=0) - 3.7
    assert np.abs(error_v).max() < CELL_ERROR_LIMIT_V + 1e-4
    assert error_v.std() > 1e-4


def test_stuck_and_noisy_inputs_leave_their_neighbours_alone():
    rng = np.random.default_rng(3)
    inputs = CellInputs(12, rng, NoisePool(rng))
    inputs.stuck_v[4] = 2.0
    inputs.extra_noise_v[7] = 0.1
    inputs.faults_changed()
    seen = np.array([inputs.read(np.full(12, 3.7)) for _ in range(300)])
    assert (seen[:, 4] == 2.0).all()
    assert 0.05 < seen[:, 7].std() < 0.2
    assert seen[:, [0, 3, 5, 6, 8, 11]].std(axis=0).max() < 1e-3
