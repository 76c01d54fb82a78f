from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import ShapeError
from app.estimation.prediction.constant_current import CellKnowledge, OperatingPoint, carry_forward
from tests.open_loop import simulate

CELL = load_cell("samsung-25r-10p")


def point(soc, n=3, degc=25.0):
    return OperatingPoint(np.full(n, soc), np.zeros((CELL.n_rc, n)), np.full(n, degc))


@pytest.mark.parametrize("current_a", [-40.0, 0.0, 150.0])
def test_the_closed_form_is_the_stepped_circuit(current_a):
    time_s = np.linspace(0.0, 30.0, 300)
    soc, voltage_v = simulate(CELL, time_s, np.full(300, current_a), np.full(300, 25.0), 0.5)
    to = carry_forward(CELL, point(0.5), CellKnowledge(), np.array(current_a), np.array(30.0), np.inf)
    np.testing.assert_allclose(to.soc, soc[-1], atol=1e-6)
    np.testing.assert_allclose(to.voltage_v, voltage_v[-1], atol=0.01)


def test_heat_is_the_loss_less_the_cooling():
    def warmed(cooling_w):
        to = carry_forward(CELL, point(0.5), CellKnowledge(cooling_w=cooling_w), np.array(100.0), np.array(60.0), 430.0)
        return to.temperature_degc[0] - 25.0, to.temperature_sigma_degc[0]

    (free, sigma), (cooled, same) = warmed(0.0), warmed(10.0)
    assert free - cooled == pytest.approx(10.0 * 60.0 / 430.0)
    assert sigma == same > 1.0
    assert warmed(1e6)[0] == 0.0, "a prediction does not cool the cells"


def test_what_is_known_is_taken_of_the_cells_asked_for():
    known = CellKnowledge(np.array([0.01, 0.02, 0.03]), resistance_factor=1.2, capacity_ah=np.array([20.0, 22.0, 24.0]))
    part = known.of(np.array([2, 0]))
    np.testing.assert_array_equal(part.soc_sigma, [0.03, 0.01])
    np.testing.assert_array_equal(part.capacity_ah, [24.0, 20.0])
    assert part.resistance_factor == 1.2


def ahead(current_a, time_s, known=None, soc=0.5, **words):
    known = known or CellKnowledge(**words)
    return carry_forward(CELL, point(soc), known, np.array(current_a), np.array(time_s), np.inf)


@given(st.floats(-50.0, 200.0), st.floats(0.0, 60.0), st.floats(0.0, 60.0))
def test_two_times_in_a_row_move_the_charge_of_both(current_a, first_s, second_s):
    once = ahead(current_a, first_s + second_s).soc
    parts = ahead(current_a, second_s, soc=float(ahead(current_a, first_s).soc[0])).soc
    np.testing.assert_allclose(parts, once, atol=1e-12)


@given(st.floats(0.0, 200.0), st.floats(0.0, 200.0), st.floats(0.1, 60.0))
def test_more_current_is_less_voltage_and_less_charge(one_a, other_a, time_s):
    less, more = (ahead(each, time_s) for each in sorted((one_a, other_a)))
    assert (more.voltage_v <= less.voltage_v + 1e-12).all()
    assert (more.soc <= less.soc).all()


@given(st.floats(-50.0, 200.0), st.floats(0.0, 60.0), st.floats(0.0, 0.1), st.floats(0.0, 0.5))
def test_what_is_less_sure_makes_a_wider_band(current_a, time_s, soc_sigma, resistance_sigma):
    sure = ahead(current_a, time_s)
    unsure = ahead(current_a, time_s, soc_sigma=soc_sigma, resistance_sigma=resistance_sigma)
    assert (unsure.voltage_sigma_v >= sure.voltage_sigma_v).all()
    np.testing.assert_array_equal(unsure.voltage_v, sure.voltage_v)


def test_a_cell_that_resists_more_drops_more_in_proportion():
    ocv_v = CELL.ocv.voltage(ahead(100.0, 5.0).soc)
    plain, grown = (ocv_v - ahead(100.0, 5.0, resistance_factor=factor).voltage_v for factor in (1.0, 1.5))
    np.testing.assert_allclose(grown, 1.5 * plain)


def test_a_smaller_capacity_empties_sooner():
    capacity_ah = np.array([0.5, 1.0, 2.0]) * CELL.capacity_ah
    moved = 0.5 - ahead(50.0, 60.0, capacity_ah=capacity_ah).soc
    np.testing.assert_allclose(moved, 50.0 * 60.0 / 3600.0 / capacity_ah)


def test_charging_counts_the_efficiency_and_discharging_does_not():
    out, back = 0.5 - ahead(30.0, 60.0).soc, ahead(-30.0, 60.0).soc - 0.5
    np.testing.assert_allclose(back, CELL.coulombic_efficiency * out)


def test_beyond_the_measured_currents_the_drop_grows_faster_and_is_less_sure():
    most_a = CELL.fit_current_max_a
    within, beyond = (ahead(factor * most_a, 1.0) for factor in (1.0, 2.0))
    drops = [CELL.ocv.voltage(each.soc) - each.voltage_v for each in (within, beyond)]
    assert (drops[1] > 2.0 * drops[0]).all()
    assert (beyond.voltage_sigma_v / drops[1] > within.voltage_sigma_v / drops[0]).all()


@pytest.mark.parametrize("current_a", [-100.0, 100.0])
def test_hysteresis_takes_its_half_gap_in_either_direction(current_a):
    with_gap = replace(CELL, hysteresis_v=0.02)
    one, other = (
        carry_forward(cell, point(0.5), CellKnowledge(), np.array(current_a), np.array(5.0), np.inf)
        for cell in (CELL, with_gap)
    )
    np.testing.assert_allclose(np.sign(current_a) * (one.voltage_v - other.voltage_v), 0.02)


def test_currents_and_times_make_a_table_over_the_cells():
    to = carry_forward(
        CELL, point(0.5), CellKnowledge(), np.array([[0.0], [50.0]])[:, None], np.array([[1.0], [10.0], [30.0]]), 430.0
    )
    assert to.voltage_v.shape == (2, 3, 3)
    np.testing.assert_array_equal(to.voltage_v[1, 2], ahead(50.0, 30.0).voltage_v)


def test_a_cell_without_a_temperature_is_taken_at_25_and_one_without_a_soc_is_left_out():
    states = OperatingPoint(np.array([0.5, np.nan]), np.zeros((CELL.n_rc, 2)), np.array([np.nan, 25.0]))
    to = carry_forward(CELL, states, CellKnowledge(), np.array(50.0), np.array(10.0), np.inf)
    assert to.voltage_v[0] == ahead(50.0, 10.0).voltage_v[0]
    assert np.isnan(to.voltage_v[1])


@pytest.mark.parametrize("branches", [np.zeros((CELL.n_rc + 1, 3)), np.zeros((CELL.n_rc, 2)), np.zeros(3)])
def test_states_of_another_model_are_refused(branches):
    states = OperatingPoint(np.full(3, 0.5), branches, np.full(3, 25.0))
    with pytest.raises(ShapeError, match="branch_a"):
        carry_forward(CELL, states, CellKnowledge(), np.array(1.0), np.array(1.0), np.inf)
