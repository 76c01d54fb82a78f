from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.cell_model.circuit import CellLimits, CellModel, charge_moved_coulomb
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.errors import ModelError
from tests.campaign import examples
from tests.open_loop import simulate


def cell(n_rc=1, **changes):
    model = CellModel(
        name="test",
        capacity_ah=2.0,
        ocv=OcvCurve([0.0, 1.0], [3.0, 4.0]),
        soc_grid=[0.0, 1.0],
        temperature_grid_degc=[0.0, 40.0],
        r0_ohm=[[0.04, 0.02], [0.02, 0.01]],
        r_ohm=np.full((n_rc, 2, 2), 0.03),
        tau_s=np.full((n_rc, 2, 2), 20.0),
    )
    return replace(model, **changes)


def test_tables_are_linear_in_soc_and_temperature_and_hold_outside():
    model = cell()
    assert model.parameters(0.5, 20.0)[0] == pytest.approx(0.0225)
    assert model.parameters(-1.0, -50.0)[0] == pytest.approx(0.04)
    assert model.parameters(2.0, 90.0)[0] == pytest.approx(0.01)


@pytest.mark.parametrize("n_rc", range(5))
def test_a_held_current_charges_every_rc_pair_exactly_whatever_the_step(n_rc):
    model = cell(n_rc)
    for dt in (0.1, 60.0):
        time = np.arange(0.0, 120.0 + dt / 2, dt)
        current = np.where(time > 0.0, 3.0, 0.0)
        soc, volts = simulate(model, time, current, np.full(time.shape, 20.0), 0.8)
        expected_soc = 0.8 - 3.0 * 120.0 / 7200.0
        drop = 3.0 * model.parameters(expected_soc, 20.0)[0] + n_rc * 0.03 * 3.0 * (1.0 - np.exp(-120.0 / 20.0))
        assert soc[-1] == pytest.approx(expected_soc)
        assert volts[-1] == pytest.approx(3.0 + expected_soc - drop, abs=1e-12)


def test_trapezoidal_counting_halves_a_step_of_current():
    model = cell(0)
    soc, _ = simulate(model, np.array([0.0, 3600.0]), np.array([0.0, 1.0]), np.full(2, 20.0), 1.0, trapezoidal=True)
    assert soc[-1] == pytest.approx(0.75)


def test_charging_keeps_only_the_efficient_share():
    model = cell(coulombic_efficiency=0.9)
    assert charge_moved_coulomb(model, [10.0, -10.0], 2.0).tolist() == [20.0, -18.0]


def test_overpotential_grows_like_asinh():
    model = cell(0, overpotential_v=np.full((2, 2), 0.01), overpotential_current_a=2.0)
    without = cell(0)
    lost = without.terminal_voltage(0.5, np.zeros((0,)), 8.0) - model.terminal_voltage(0.5, np.zeros((0,)), 8.0)
    assert lost == pytest.approx(0.01 * np.arcsinh(4.0))


def test_hysteresis_pulls_down_after_discharge_and_up_after_charge():
    model = cell(0, hysteresis_v=0.02, hysteresis_rate=100.0)
    time = np.arange(0.0, 3600.0, 10.0)
    for sign in (1.0, -1.0):
        soc, volts = simulate(model, time, np.full(time.shape, 0.5 * sign), np.full(time.shape, 40.0), 0.5)
        drop = 0.5 * sign * model.parameters(soc[-1], 40.0)[0]
        assert volts[-1] + drop - model.ocv.voltage(soc[-1]) == pytest.approx(-0.02 * sign, abs=1e-6)


def test_time_that_runs_backwards_is_refused():
    with pytest.raises(ModelError, match="backwards"):
        simulate(cell(), np.array([0.0, 2.0, 1.0]), np.zeros(3), np.full(3, 20.0), 0.5)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"soc_grid": [0.0, 0.0]}, "soc_grid"),
        ({"temperature_grid_degc": [20.0]}, "r0_ohm"),
        ({"r0_ohm": [[0.1, 0.1], [0.1, -0.1]]}, "r0_ohm"),
        ({"r_ohm": np.zeros((5, 2, 2)), "tau_s": np.ones((5, 2, 2))}, "r_ohm"),
        ({"r_ohm": np.full((1, 2, 2), np.nan)}, "r_ohm[0]"),
        ({"tau_s": np.zeros((1, 2, 2))}, "tau_s[0]"),
        ({"soc_grid": np.array([0.0, 100.0])}, "soc_grid"),
        ({"temperature_grid_degc": np.array([273.0, 298.0])}, "temperature_grid_degc"),
        ({"capacity_ah": 0.0}, "capacity_ah"),
        ({"hysteresis_v": -0.1}, "hysteresis_v"),
        ({"coulombic_efficiency": 1.1}, "coulombic_efficiency"),
        ({"v_min_v": 4.3}, "v_min_v"),
        ({"v_max_v": 11.0}, "v_max_v"),
        ({"v_nominal_v": 4.3}, "v_nominal_v"),
        ({"mass_kg": 0.0}, "mass_kg"),
        ({"mass_kg": 45.0}, "mass_kg"),  # grams
        ({"r0_ohm": [[40.0, 20.0], [20.0, 10.0]]}, "r0_ohm"),  # milliohms
        ({"r0_ohm": [[0.04, 0.02]]}, "r0_ohm"),
        ({"r_ohm": np.full((1, 2, 2), 0.03), "tau_s": np.full((2, 2, 2), 20.0)}, "r_ohm"),
        ({"r_ohm": np.full((1, 2, 2), -0.03)}, "r_ohm[0]"),
        ({"overpotential_current_a": 0.0}, "overpotential_current_a"),
        ({"overpotential_v": np.full((2, 2), -0.01)}, "overpotential_v"),
        ({"hysteresis_rate": float("inf")}, "hysteresis_rate"),
        ({"fit_voltage_rms_v": float("nan")}, "fit_voltage_rms_v"),
        ({"activation_sigma_j_mol": -1.0}, "activation_sigma_j_mol"),
        ({"coulombic_efficiency": 0.4}, "coulombic_efficiency"),
        ({"fit_temperature_degc": []}, "fit_temperature_degc"),
        ({"ocv": OcvCurve([0.0, 1.0], [3.0, 12.0])}, "ocv"),
    ],
)
def test_numbers_that_describe_no_cell_are_refused_by_name(changes, field):
    with pytest.raises(ModelError) as caught:
        cell(**changes)
    assert caught.value.field == field


def test_the_open_circuit_voltage_of_a_temperature_is_a_shift_of_the_curve():
    model = cell(ocv_shift_v=[[-0.04, -0.02], [0.0, 0.0]])
    assert model.open_circuit_voltage(0.5, 40.0) == pytest.approx(3.5)
    assert model.open_circuit_voltage(0.5, 20.0) == pytest.approx(3.485)
    assert model.open_circuit_voltage(0.0, -30.0) == pytest.approx(2.96)
    assert cell().open_circuit_voltage(0.5, 0.0) == pytest.approx(3.5)
    with pytest.raises(ModelError, match="ocv_shift_v"):
        cell(ocv_shift_v=[[0.0, 0.0]])
    with pytest.raises(ModelError, match="ocv_shift_v"):
        cell(ocv_shift_v=[[0.0, 0.0], [0.0, 1.0]])


def test_uncertainty_begins_where_measured_temperatures_end_not_where_tables_do():
    """Tables from 0 to 40 degC, measured from 20 to 30."""
    model = cell(fit_temperature_degc=[20.0, 25.0, 30.0], activation_sigma_j_mol=12e3)
    np.testing.assert_allclose(model.drop_error([20.0, 25.0, 30.0]), 0.0, atol=1e-12)
    assert model.drop_error(0.0) == pytest.approx(12e3 / 8.314 * (1 / 273.15 - 1 / 293.15), rel=1e-3)
    assert model.drop_error(-10.0) > model.drop_error(0.0) > model.drop_error(22.5) > 0.0
    assert model.drop_error(40.0) > model.drop_error(32.0) > 0.0
    assert model.ocv_error_v(0.0) == pytest.approx(20.0 * 3e-4, rel=0.1)
    assert cell().drop_error(0.0) == 0.0, "a file of an earlier version vouches for its tables"
    with pytest.raises(ModelError, match="fit_temperature_degc"):
        cell(fit_temperature_degc=[30.0, 20.0])


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"temperature_min_degc": -100.0}, "limits.temperature_min_degc"),
        ({"temperature_max_degc": 333.0}, "limits.temperature_max_degc"),
        ({"temperature_min_degc": 60.0, "temperature_max_degc": 60.0}, "limits.temperature_min_degc"),
        ({"discharge_max_a": 0.0}, "limits.discharge_max_a"),
        ({"charge_max_a": -40.0}, "limits.charge_max_a"),
        ({"charge_max_a": float("inf")}, "limits.charge_max_a"),
    ],
)
def test_limits_of_no_data_sheet_are_refused_by_name(given, field):
    with pytest.raises(ModelError) as caught:
        CellLimits(**given)
    assert caught.value.field == field


def test_limits_that_were_not_said_are_none():
    assert CellLimits(temperature_min_degc=-20.0).temperature_max_degc is None
    assert cell().limits == CellLimits()


inside = st.floats(0.0, 1.0), st.floats(0.0, 40.0)


@settings(max_examples=examples(100))
@given(*inside)
def test_a_parameter_lies_between_the_corners_of_its_table(soc, degc):
    model = cell()
    r0 = float(model.parameters(soc, degc)[0])
    by_hand = (1 - degc / 40) * (0.04 - 0.02 * soc) + degc / 40 * (0.02 - 0.01 * soc)
    assert r0 == pytest.approx(by_hand, rel=1e-12)


@settings(max_examples=examples(100))
@given(st.lists(st.floats(-0.2, 1.2), min_size=1, max_size=5), st.lists(st.floats(-30, 70), min_size=1, max_size=4))
def test_many_values_are_the_same_as_one_by_one(socs, temperatures):
    """SOC and temperature broadcast together, as in a grid of both."""
    model = cell(2, ocv_shift_v=[[-0.04, -0.02], [0.0, 0.01]])
    soc, degc = np.array(socs)[:, None], np.array(temperatures)
    table, volts = model.parameters(soc, degc), model.open_circuit_voltage(soc, degc)
    assert table.shape == (2 + 2 * 2, len(socs), len(temperatures))
    for i, j in np.ndindex(volts.shape):
        np.testing.assert_array_equal(table[:, i, j], model.parameters(socs[i], temperatures[j]))
        assert volts[i, j] == model.open_circuit_voltage(socs[i], temperatures[j])


@settings(max_examples=examples(100))
@given(st.floats(-8.0, 8.0), st.floats(0.05, 0.95), st.floats(0.0, 40.0))
def test_discharge_lowers_and_charge_raises_the_voltage_alike(current, soc, degc):
    """Every term of the drop is odd in the current."""
    model = cell(1, overpotential_v=np.full((2, 2), 0.01))
    ocv = model.open_circuit_voltage(soc, degc)
    low = model.terminal_voltage(soc, [current], current, degc)
    high = model.terminal_voltage(soc, [-current], -current, degc)
    assert (low - ocv) == pytest.approx(ocv - high, abs=1e-12)
    assert (ocv - low) * current >= 0.0


def test_the_lasting_resistance_is_what_an_hour_of_current_shows():
    """Measured as on a bench: voltage at rest less voltage under a 3C current once its pairs are charged."""
    model = cell(2, overpotential_v=np.full((2, 2), 0.01), overpotential_current_a=2.0)
    i = 3.0 * model.capacity_ah
    drop = model.terminal_voltage(0.5, [0.0, 0.0], 0.0, 25.0) - model.terminal_voltage(0.5, [i, i], i, 25.0)
    assert model.lasting_ohm(25.0) == pytest.approx(drop / i)
    assert model.drop_per_c_v == pytest.approx(drop / 3.0)
    assert model.lasting_ohm([0.0, 40.0])[0] > model.lasting_ohm([0.0, 40.0])[1]


@settings(max_examples=examples(100))
@given(st.lists(st.integers(-20, 60), min_size=1, max_size=4, unique=True), st.floats(-40.0, 90.0))
def test_uncertainty_is_none_at_a_measured_temperature_and_grows_away_from_the_measured(measured, degc):
    model = cell(fit_temperature_degc=sorted(measured))
    for uncertainty in (model.drop_error, model.ocv_error_v):
        assert np.asarray(uncertainty([float(each) for each in measured])) == pytest.approx(0.0, abs=1e-12)
        assert uncertainty(degc) >= 0.0
        assert uncertainty(max(measured) + 20.0) > uncertainty(max(measured) + 10.0) > 0.0
        assert uncertainty(min(measured) - 20.0) > uncertainty(min(measured) - 10.0) > 0.0


@settings(max_examples=examples(60))
@given(st.floats(-30.0, 60.0), st.floats(1.0, 30.0))
def test_between_two_measured_temperatures_is_less_uncertainty_than_beyond_one(low, apart):
    both = cell(fit_temperature_degc=[low, low + apart])
    alone = cell(fit_temperature_degc=[low])
    middle = low + apart / 2
    assert both.drop_error(middle) < alone.drop_error(middle)
    assert both.ocv_error_v(middle) < alone.ocv_error_v(middle)


def test_a_charge_moved_is_the_current_times_the_time_each_its_own():
    model = cell(coulombic_efficiency=0.99)
    moved = charge_moved_coulomb(model, np.array([2.0, 0.0, -2.0]), np.array([1.0, 5.0, 10.0]))
    assert moved.tolist() == pytest.approx([2.0, 0.0, -19.8])
