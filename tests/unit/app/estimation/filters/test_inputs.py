"""What a filter is spared: missing and impossible measurements."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.filters.inputs import CURRENT_MAX_C, TEMPERATURE_UNKNOWN_DEGC, InputGuard
from app.estimation.filters.states import CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning

CELL = PackedCell(load_cell("samsung-25r-10p"))
VOLTS, DEGC = [3.7, 3.8], [25.0, 30.0]


@pytest.fixture
def guard():
    return InputGuard(CELL, CellStates(CELL.model.n_rc, 2), Tuning())


@pytest.mark.parametrize("impossible", [float("nan"), float("inf"), 2 * CURRENT_MAX_C * CELL.model.capacity_ah])
def test_a_current_that_cannot_be_is_replaced_by_the_last_one(guard, impossible):
    assert guard.common(0.1, 40.0) == 40.0
    assert guard.common(0.1, impossible) == 40.0
    assert guard.common(0.1, -3.0) == -3.0


@pytest.mark.parametrize("reading", [0.0, 6.5535, -1.0, float("nan"), float("inf")])
def test_a_voltage_of_no_cell_is_missing_and_the_others_stay(guard, reading):
    found = guard.check(0.1, 0.0, [reading, 3.8], DEGC).voltage_v
    assert np.isnan(found[0])
    assert found[1] == 3.8


def test_a_missing_temperature_is_the_last_one_and_at_first_a_usual_one(guard):
    first = guard.check(0.1, 0.0, VOLTS, [float("nan"), 30.0]).climate
    usual = InputGuard(CELL, CellStates(CELL.model.n_rc, 2), Tuning()).check(
        0.1, 0.0, VOLTS, [TEMPERATURE_UNKNOWN_DEGC, 30.0]
    )
    np.testing.assert_array_equal(first.row + first.row_weight, usual.climate.row + usual.climate.row_weight)
    before = guard.check(0.1, 0.0, VOLTS, [5.0, 30.0]).climate
    after = guard.check(0.1, 0.0, VOLTS, [1000.0, 30.0]).climate
    np.testing.assert_array_equal(before.row + before.row_weight, after.row + after.row_weight)


def test_outside_the_tables_the_model_is_trusted_less(guard):
    low, high = CELL.temperature_grid_degc[[0, -1]]
    inside = guard.check(0.1, 0.0, VOLTS, [low, high]).climate
    assert inside.is_inside
    np.testing.assert_array_equal(inside.noise_scale, 1.0)
    outside = guard.check(0.1, 0.0, VOLTS, [low - 20.0, high + 10.0]).climate
    assert not outside.is_inside
    assert outside.noise_scale[0] > outside.noise_scale[1] > 1.0


def test_the_models_error_grows_with_current_either_way_and_repeats_itself_more_in_short_steps(guard):
    rest, drive, charge = (guard.check(0.1, i, VOLTS, DEGC) for i in (0.0, 100.0, -100.0))
    assert drive.noise_v2 == charge.noise_v2 > rest.noise_v2
    assert rest.correlation > guard.check(1.0, 0.0, VOLTS, DEGC).correlation > 1.0


@pytest.mark.parametrize("dt_s", [-0.1, float("nan"), float("inf")])
def test_a_step_that_is_none_is_refused(guard, dt_s):
    with pytest.raises(EstimatorError, match="step"):
        guard.check(dt_s, 0.0, VOLTS, DEGC)


@pytest.mark.parametrize(("volts", "degc", "name"), [([3.7], DEGC, "voltages_v"), (VOLTS, [25.0] * 3, "temperatures")])
def test_arrays_of_another_length_are_refused_by_name(guard, volts, degc, name):
    with pytest.raises(ShapeError, match=name):
        guard.check(0.1, 0.0, volts, degc)
