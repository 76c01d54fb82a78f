import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.errors import ShapeError
from app.estimation.prediction.driver_soc import WINDOW, DriverSoc


def test_driver_sees_the_lowest_cell_floored():
    reading = DriverSoc(3).step([0.559, 0.412, 0.6])
    assert (reading.percent, reading.cell) == (41, 1)
    assert reading.spread_percent == pytest.approx(18.8)


def test_average_covers_exactly_the_last_100_samples():
    driver = DriverSoc(1)
    for _ in range(WINDOW):
        driver.step([0.9])
    for _ in range(WINDOW - 1):
        reading = driver.step([0.5])
    assert reading.percent == 50  # 99 x 500 and 1 x 900 permille: 504
    assert driver.step([0.5]).percent == 50
    for _ in range(WINDOW // 2):
        reading = driver.step([0.7])
    assert reading.percent == 60


def test_averages_are_floored_not_rounded():
    driver = DriverSoc(1)
    assert driver.step([0.5099]).percent == 51
    assert driver.step([0.50]).percent == 50


def test_cells_without_an_estimate_are_left_out():
    driver = DriverSoc(2)
    assert driver.step([np.nan, np.nan]).percent is None
    reading = driver.step([np.nan, 0.3])
    assert (reading.percent, reading.cell, reading.spread_percent) == (30, 1, 0.0)


def test_wrong_shape_is_refused():
    with pytest.raises(ShapeError):
        DriverSoc(2).step([0.5])


@given(st.lists(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3), min_size=1, max_size=250))
def test_the_number_never_flatters(rows):
    driver = DriverSoc(3)
    for row in rows:
        reading = driver.step(row)
    mean = np.rint(1000.0 * np.array(rows[-WINDOW:])).mean(axis=0) / 10.0
    assert reading.percent <= mean.min() + 1e-9 < reading.percent + 1.0 + 1e-6
    assert mean[reading.cell] == pytest.approx(mean.min())
