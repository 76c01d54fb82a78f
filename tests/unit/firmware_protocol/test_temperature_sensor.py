from itertools import pairwise

import pytest

from firmware_protocol.temperature_sensor import POINTS_V, sensor_voltage_v, temperature_degc


@pytest.mark.parametrize(("degc", "volts"), [(-40, 2.44), (0, 2.17), (20, 1.92), (25, 1.86), (50, 1.59), (120, 1.30)])
def test_published_points(degc, volts):
    assert sensor_voltage_v(degc) == pytest.approx(volts)
    assert temperature_degc(volts) == pytest.approx(degc)


def test_table_falls_throughout():
    assert len(POINTS_V) == 33
    assert all(a > b for a, b in pairwise(POINTS_V))


def test_no_point_near_20_degc_is_missing():
    # copies that lost the 1.92 V point are 5 K wrong on one side of 20 degC
    assert temperature_degc(1.955) == pytest.approx(17.5)
    assert temperature_degc(1.89) == pytest.approx(22.5)


def test_cold_side_has_its_sign():
    assert temperature_degc(2.225) == pytest.approx(-4.6, abs=0.1)
    assert temperature_degc(2.122) == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("degc", [-39.5, -7, 3.3, 31.0, 61.7, 118])
def test_there_and_back(degc):
    assert temperature_degc(sensor_voltage_v(degc)) == pytest.approx(degc)


@pytest.mark.parametrize("volts", [0.0, 1.29, 2.45, 2.8, 6.5535])
def test_voltage_of_a_broken_sensor_gives_none(volts):
    assert temperature_degc(volts) is None


def test_rounding_at_the_ends_is_no_fault():
    assert temperature_degc(2.4449) == -40
    assert temperature_degc(1.2951) == 120


@pytest.mark.parametrize(("volts", "degc"), [(2.445, -40.0), (2.44, -40.0), (1.30, 120.0)])
def test_the_ends_of_the_table_are_inside_it(volts, degc):
    assert temperature_degc(volts) == pytest.approx(degc)


def test_every_published_point_is_met_from_both_sides():
    for index, volts in enumerate(POINTS_V):
        assert sensor_voltage_v(-40 + 5 * index) == pytest.approx(volts)
        assert temperature_degc(volts) == pytest.approx(-40 + 5 * index)


@pytest.mark.parametrize(("degc", "volts"), [(-80, 2.44), (200, 1.30)])
def test_beyond_the_table_the_voltage_stays(degc, volts):
    assert sensor_voltage_v(degc) == pytest.approx(volts)
