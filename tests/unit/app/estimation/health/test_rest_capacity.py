"""Capacity from rest to rest: a known cell is driven, and only true rests with a way between them teach."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.health.capacity import REST_A, REST_S, CapacityBetweenRests, CapacityTracker

CELL = load_cell()
N = 3
SHARES = np.array([0.8, 0.9, 1.0])  # shares of the nominal capacity


class Battery:
    """Cells of known capacity whose voltage is their OCV, and who listens to them."""

    def __init__(self):
        self.tracker = CapacityTracker(CELL.capacity_ah, N)
        self.between = CapacityBetweenRests(CELL, self.tracker)
        self.soc = np.full(N, 0.9)

    def run(self, current_a, seconds, dt_s=10.0, missing=()):
        told = []
        for _ in range(round(seconds / dt_s)):
            self.soc = self.soc - current_a * dt_s / 3600.0 / (CELL.capacity_ah * SHARES)
            volts = CELL.ocv.voltage(self.soc)
            volts[list(missing)] = np.nan
            told.append(self.between.step(dt_s, current_a, volts))
        return told


def draw(battery, share, missing=()):
    """Draw a share of the nominal capacity in an hour."""
    return battery.run(share * CELL.capacity_ah, 3600.0, missing=missing)


def test_two_rests_and_the_charge_between_them_give_the_capacity():
    battery = Battery()
    for _ in range(4):
        assert not any(battery.run(0.0, REST_S)) or battery.soc[0] < 0.9
        assert not any(draw(battery, 0.15)), "under way nothing is known"
    assert battery.run(0.0, REST_S)[-1]
    found = battery.tracker.capacity_ah() / CELL.capacity_ah
    assert np.abs(found - SHARES).max() < np.abs(1.0 - SHARES).max()
    assert (np.diff(found) > 0.0).all(), "the weakest cell is found weakest"


def test_the_first_rest_is_where_counting_begins():
    battery = Battery()
    before = battery.tracker.state
    assert not any(battery.run(0.0, REST_S))
    np.testing.assert_array_equal(battery.tracker.state, before)


def test_a_rest_that_is_too_short_or_not_quite_one_teaches_nothing():
    battery = Battery()
    battery.run(0.0, REST_S)
    draw(battery, 0.3)
    assert not any(battery.run(0.0, REST_S - 10.0))
    assert not any(battery.run(REST_A, 2 * REST_S)), "a current flows"
    assert battery.run(0.99 * REST_A, REST_S)[-1]


@pytest.mark.parametrize("current_a", [0.5, -0.5])
def test_a_rest_is_one_in_either_direction_of_the_sensors_noise(current_a):
    battery = Battery()
    battery.run(current_a, REST_S)
    draw(battery, 0.3)
    assert battery.run(current_a, REST_S)[-1]


def test_a_short_way_is_added_to_the_next_one():
    battery = Battery()
    battery.run(0.0, REST_S)
    draw(battery, 0.05)
    assert not any(battery.run(0.0, REST_S)), "five percent drown in the errors"
    draw(battery, 0.05)
    assert battery.run(0.0, REST_S)[-1], "ten percent do not"


def test_a_cell_that_is_not_measured_learns_nothing_and_holds_up_nobody():
    battery = Battery()
    before = battery.tracker.state
    battery.run(0.0, REST_S, missing=(1,))
    draw(battery, 0.3, missing=(1,))
    assert battery.run(0.0, REST_S, missing=(1,))[-1]
    np.testing.assert_array_equal(battery.tracker.state[:, 1], before[:, 1])
    assert (battery.tracker.state[:, 0] != before[:, 0]).any()


def test_a_charge_teaches_as_well_as_a_discharge():
    battery = Battery()
    battery.soc = np.full(N, 0.3)
    battery.run(0.0, REST_S)
    draw(battery, -0.4)
    assert battery.run(0.0, REST_S)[-1]
    assert (np.diff(battery.tracker.capacity_ah()) > 0.0).all()
