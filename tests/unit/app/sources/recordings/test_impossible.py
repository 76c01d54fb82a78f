"""Numbers that are no measurement become missing and are counted; every real one stays."""

import numpy as np
import pytest

from app.sources.recordings.impossible import cell_voltages, measured_currents, measured_temperatures
from app.words import render


def taken(function, values):
    notes = []
    return function(np.asarray(values, dtype=float), notes), [render(note) for note in notes]


DRIVE = np.linspace(-20.0, 60.0, 200)


@pytest.mark.parametrize(
    ("odd", "drive"),
    [
        *((odd, DRIVE) for odd in (-(2**31) / 1000, (2**31 - 1) / 1000, 2**31, 655.35, 6553.5, 327.67, 3276.7)),
        *((odd, np.abs(DRIVE)) for odd in (655.36 - 5.0, 6553.6 - 12.3)),  # read without a sign
    ],
)
def test_the_overflow_of_an_integer_is_no_current(odd, drive):
    values = drive.copy()
    values[[17, 80]] = odd
    found, notes = taken(measured_currents, values)
    assert np.flatnonzero(np.isnan(found)).tolist() == [17, 80]
    np.testing.assert_array_equal(np.delete(found, [17, 80]), np.delete(drive, [17, 80]))
    assert notes == ["2 currents are an integer's overflow: no measurement"]


PULSES = np.repeat([0.0, 62.0, 0.0, 4.0, 0.0], 20)


@pytest.mark.parametrize(
    "values",
    [
        PULSES,
        PULSES - 1.0,
        10.5 * (PULSES - 1.0),
        DRIVE,
        DRIVE * 6,
        np.zeros(50),
        np.full(50, 32.767),
        np.linspace(0, 655.35, 100),
    ],
)
def test_currents_that_are_measured_stay(values):
    found, notes = taken(measured_currents, values)
    np.testing.assert_array_equal(found, values)
    assert notes == []


def test_an_absent_sensor_is_missing_and_a_cold_battery_is_not():
    found, notes = taken(measured_temperatures, [[25.0, -40.0], [26.0, -40.0]])
    np.testing.assert_array_equal(np.isnan(found), [[False, True]] * 2)
    assert notes == ["2 temperatures of -40 degC, sensors that are not fitted: no measurement"]
    cold = [[-38.0, -40.0], [-39.0, -40.0]]
    np.testing.assert_array_equal(taken(measured_temperatures, cold)[0], cold)
    np.testing.assert_array_equal(taken(measured_temperatures, [[-40.0], [-40.0]])[0], [[-40.0], [-40.0]])


def test_a_sign_that_marks_a_cell_is_taken_off():
    found, notes = taken(cell_voltages, [[-3.95, 3.948], [3.947, -3.946]])
    np.testing.assert_array_equal(found, [[3.95, 3.948], [3.947, 3.946]])
    assert notes == ["2 cell voltages have a sign that marks the cell: taken without it"]


@pytest.mark.parametrize("values", [[[3.9, -1.0]], [[-3.9]], [[3.9, 3.8]]])
def test_a_negative_voltage_that_is_no_cells_magnitude_stays_what_it_is(values):
    np.testing.assert_array_equal(taken(cell_voltages, values)[0], values)
