"""What a filter is spared: missing and impossible measurements."""

import numpy as np
import pytest

from app.estimation.filters.reference.state import TEMPERATURE_UNKNOWN_DEGC, motion_of
from tests.unit.app.estimation.filters.reference.cells import MODEL, sample, setup_of, state_at

SETUP = setup_of()
TWO = state_at(SETUP, [0.5, 0.6])


@pytest.mark.parametrize("reading", [0.0, 6.5535, -1.0, float("nan"), float("inf")])
def test_a_voltage_of_no_cell_is_missing_and_the_others_stay(reading):
    _, _, measured = sample(SETUP, TWO, volts=[reading, 3.8])
    assert measured.is_measured.tolist() == [False, True]
    assert measured.voltage_v[1] == 3.8


@pytest.mark.parametrize("reading", [float("nan"), 1000.0, -300.0, float("inf")])
def test_a_missing_temperature_is_the_last_one_and_at_first_a_usual_one(reading):
    state, _, _ = sample(SETUP, TWO, degc=[reading, 30.0])
    assert state.temperature_degc.tolist() == [TEMPERATURE_UNKNOWN_DEGC, 30.0]
    state, _, _ = sample(SETUP, state, degc=[5.0, 31.0])
    state, _, measured = sample(SETUP, state, degc=[reading, reading])
    assert state.temperature_degc.tolist() == [5.0, 31.0]
    row, weight = measured.place
    assert (row + weight == sum(SETUP.cell.place_temperature(np.array([5.0, 31.0])))).all()


def test_outside_the_tables_the_model_is_trusted_less():
    low, high = SETUP.cell.temperature_degc[[0, -1]]
    _, _, inside = sample(SETUP, TWO, degc=[low, high])
    assert inside.cold.tolist() == [1.0, 1.0]
    _, _, outside = sample(SETUP, TWO, degc=[low - 20.0, high + 10.0])
    assert outside.cold[0] > outside.cold[1] > 1.0


def test_the_models_error_grows_with_current_either_way_and_repeats_itself_more_in_short_steps():
    rest, drive, charge = (motion_of(SETUP, 0.1, i) for i in (0.0, 100.0, -100.0))
    assert drive.noise_v2 == charge.noise_v2 > rest.noise_v2
    assert rest.correlation > motion_of(SETUP, 1.0, 0.0).correlation > 1.0


def test_charging_moves_less_charge_than_it_takes_where_some_is_lost():
    from dataclasses import replace

    lossy = setup_of(replace(MODEL, coulombic_efficiency=0.98))
    assert motion_of(lossy, 3600.0, -10.0).moved_ah == pytest.approx(-9.8)
    assert motion_of(lossy, 3600.0, 10.0).moved_ah == pytest.approx(10.0)
