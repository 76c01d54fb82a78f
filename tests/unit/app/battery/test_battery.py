import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.battery.battery import Battery, each_cell, spread, spread_in_packs


@given(st.integers(1, 300), st.integers(1, 300))
def test_spread_sensors_stand_for_every_cell(n_sensors, n_cells):
    sensors = spread(n_sensors, range(n_cells))
    assert len(sensors) == n_sensors
    assert all(cells for cells in sensors)
    assert {cell for cells in sensors for cell in cells} == set(range(n_cells))


@given(st.lists(st.integers(1, 20), min_size=1, max_size=8), st.integers(1, 25))
def test_no_sensor_stands_for_cells_of_two_segments(segments, each):
    battery = Battery("x", tuple(segments), sensors=spread_in_packs(each * len(segments), tuple(segments)))
    for cells in battery.sensors:
        assert len({battery.place(cell)[0] for cell in cells}) == 1


def test_a_cell_has_the_highest_temperature_of_its_sensors():
    battery = Battery("x", (3,), sensors=((0,), (0, 1), ()))
    found = battery.cell_temperatures(np.array([[20.0, 25.0, 99.0], [np.nan, 30.0, 0.0]]))
    np.testing.assert_array_equal(found, [[25.0, 25.0, np.nan], [30.0, 30.0, np.nan]])


def test_one_sensor_a_cell_changes_nothing():
    battery = Battery("x", (4,), sensors=each_cell(4))
    np.testing.assert_array_equal(battery.cell_temperatures(np.arange(4.0)), np.arange(4.0))
