from itertools import pairwise

import pytest

from firmware_protocol.ltc6804 import SENSOR_FIRST_DEGC, SENSOR_POINTS_V, SENSOR_STEP_DEGC


@pytest.mark.parametrize(("degc", "volts"), [(-40, 2.44), (0, 2.17), (20, 1.92), (25, 1.86), (50, 1.59), (120, 1.30)])
def test_published_points(degc, volts):
    assert SENSOR_POINTS_V[(degc - SENSOR_FIRST_DEGC) // SENSOR_STEP_DEGC] == volts


def test_table_falls_throughout():
    assert len(SENSOR_POINTS_V) == 33
    assert all(a > b for a, b in pairwise(SENSOR_POINTS_V))
