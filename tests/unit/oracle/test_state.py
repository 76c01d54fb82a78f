"""What a filter is spared: missing and impossible measurements."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.filters.tables import LASTING_DROP
from tests.oracle.cells import MODEL, sample, setup_of, state_at
from tests.oracle.state import (
    TEMPERATURE_UNKNOWN_DEGC,
    empty_growth,
    lasting_v2,
    motion_of,
    noise_v2,
)

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


MEASURED = setup_of(replace(MODEL, fit_temperature_degc=np.array([20.0, 30.0])))


def test_where_nothing_was_measured_the_model_is_trusted_less_inside_its_tables_too():
    _, drive, inside = sample(MEASURED, TWO, degc=[20.0, 30.0], current_a=50.0)
    _, _, outside = sample(MEASURED, TWO, degc=[0.0, 15.0], current_a=50.0)
    uncertaintyed = noise_v2(MEASURED, drive, outside)
    known = MEASURED.tuning.voltage_variance(outside.uncertainty[LASTING_DROP] * 50.0)
    known_v2 = MEASURED.tuning.voltage_variance(inside.uncertainty[LASTING_DROP] * 50.0)
    np.testing.assert_allclose(noise_v2(MEASURED, drive, inside), known_v2)
    assert (uncertaintyed > known).all()
    assert uncertaintyed[0] > uncertaintyed[1]
    _, rest, cold = sample(MEASURED, TWO, degc=[0.0, 15.0])
    rest_v2 = SETUP.tuning.voltage_variance(np.zeros(2))
    np.testing.assert_allclose(
        noise_v2(MEASURED, rest, cold), rest_v2, err_msg="without current resistances do not matter"
    )


def test_in_the_cold_a_cell_looks_empty_early():
    state, _, warm = sample(SETUP, state_at(SETUP, [0.05, 0.25]), degc=25.0)
    _, _, cold = sample(SETUP, TWO, degc=0.0)
    assert empty_growth(SETUP, state, warm)[0] > 1.5
    assert empty_growth(SETUP, state, warm)[1] == 1.0
    assert (empty_growth(SETUP, state, cold) > empty_growth(SETUP, state, warm)).all()


def test_the_lasting_error_grows_with_the_slow_current_and_with_what_was_not_measured():
    rest, motion, warm = sample(MEASURED, TWO, degc=25.0)
    _, _, cold = sample(MEASURED, TWO, degc=0.0)
    driven = replace(rest, branch_a=np.full_like(rest.branch_a, 50.0))
    at_rest, in_a_drive, in_the_cold = (
        lasting_v2(MEASURED, state, motion, measured)[0]
        for state, measured in ((rest, warm), (driven, warm), (driven, cold))
    )
    assert MEASURED.tuning.lasting_v**2 == pytest.approx(at_rest, rel=0.02)
    assert at_rest < in_a_drive < in_the_cold
    wide = setup_of(replace(MODEL, hysteresis_v=0.02))
    assert lasting_v2(wide, rest, motion, warm)[0] > at_rest


def test_the_models_error_grows_with_current_either_way_and_repeats_itself_more_in_short_steps():
    rest, drive, charge = (motion_of(SETUP, 0.1, i) for i in (0.0, 100.0, -100.0))
    _, _, warm = sample(SETUP, TWO, degc=25.0)
    in_a_drive, in_a_charge, at_rest = (noise_v2(SETUP, motion, warm)[0] for motion in (drive, charge, rest))
    assert in_a_drive == in_a_charge > at_rest
    assert rest.correlation > motion_of(SETUP, 1.0, 0.0).correlation > 1.0


def test_charging_moves_less_charge_than_it_takes_where_some_is_lost():
    lossy = setup_of(replace(MODEL, coulombic_efficiency=0.98))
    assert motion_of(lossy, 3600.0, -10.0).moved_ah == pytest.approx(-9.8)
    assert motion_of(lossy, 3600.0, 10.0).moved_ah == pytest.approx(10.0)
