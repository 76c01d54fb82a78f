"""The tables of an identified cell: their temperatures, what lies between and beyond, and what was measured."""

import numpy as np
import pytest

from app.estimation.cell_model.circuit import ACTIVATION_SIGMA_J_MOL, GAS_CONSTANT, KELVIN
from app.estimation.identification.cell_tables import (
    activation_energy,
    cell_model,
    ocv_shift,
    seen_temperatures,
    table_temperatures,
    temperature_knots,
)
from app.estimation.identification.design import (
    BLEND_SOC,
    DEFAULT_ACTIVATION_J_MOL,
    OFFSET_SOC,
    OVERPOTENTIAL_SOC,
    RESISTANCE_SOC,
)
from app.estimation.identification.problem import Solution
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.recording.cell_recording import Recording

CAPACITY_AH = 3.0
GRID = np.linspace(0.0, 1.0, 101)
SLOW = SlowCurves(GRID, 3.0 + GRID, 3.04 + GRID, CAPACITY_AH, 0.1, True)


def recording(low, high=None, rows=1000):
    degc = np.linspace(low, low if high is None else high, rows)
    zeros = np.zeros(rows)
    return Recording("test", np.arange(rows) * 1.0, zeros, zeros + 3.7, degc, zeros + 0.5, ())


def solution(knots, factors, shifts_v=None):
    """A cell of 20 + 10 mohm, so many times what the usual activation energy says at each temperature."""
    factors = np.array(factors)[:, None]
    n_t = len(knots)
    shifts = np.zeros(n_t) if shifts_v is None else np.array(shifts_v)
    x = [np.repeat(0.02 * factors, RESISTANCE_SOC.size, axis=1), np.repeat(0.01 * factors, RESISTANCE_SOC.size, axis=1)]
    x += [np.zeros(n_t * OVERPOTENTIAL_SOC.size), np.full(BLEND_SOC.size, 0.5), np.repeat(shifts, OFFSET_SOC.size)]
    return Solution(0.0, (20.0,), np.array(knots), np.concatenate([np.ravel(part) for part in x]))


def model(found, *recordings):
    return cell_model(found, SLOW, 25.0, recordings, CAPACITY_AH, "test", "test")


def test_tests_near_in_temperature_share_tables_and_those_apart_do_not():
    tests = [recording(25.0, 27.0), recording(24.0, 30.0), recording(0.0, 3.0), recording(-10.0)]
    np.testing.assert_allclose(temperature_knots(tests), [-10.0, 1.5, 26.5], atol=0.1)


def test_one_temperature_has_one_set_of_tables_and_a_drive_that_heats_up_two():
    assert temperature_knots([recording(24.0, 27.0)]) == pytest.approx([25.5], abs=0.1)
    np.testing.assert_allclose(temperature_knots([recording(20.0, 40.0)]), [21.0, 39.0], atol=0.1)
    np.testing.assert_array_equal(temperature_knots([recording(np.nan)]), [25.0])


def test_seen_are_the_temperatures_of_the_recordings_alone():
    seen = seen_temperatures([recording(-10.0, -7.0), recording(20.0, 38.0)])
    assert seen[0] == pytest.approx(-10.0, abs=0.1)
    assert seen[-1] == pytest.approx(38.0, abs=0.3)
    between = (seen > -6.0) & (seen < 19.0)
    assert not between.any()
    assert np.diff(seen[seen > 15.0]).max() <= 5.0


def test_rows_of_the_tables_hold_the_temperatures_of_the_tests():
    rows = table_temperatures(np.array([-9.6, 0.5, 25.8]))
    assert {-30.0, -9.6, 0.5, 25.8, 60.0} <= set(rows.tolist())
    assert np.diff(rows).min() > 2.0
    assert table_temperatures(np.array([-35.0]))[0] <= -35.0


def test_a_cell_measured_at_one_temperature_follows_the_usual_activation_energy():
    found = model(solution([25.0], [1.0]), recording(24.0, 26.0))
    cold, warm = (found.parameters(0.5, degc)[0] for degc in (0.0, 25.0))
    expected = DEFAULT_ACTIVATION_J_MOL / GAS_CONSTANT * (1 / KELVIN - 1 / (KELVIN + 25.0))
    assert np.log(cold / warm) == pytest.approx(expected, rel=1e-6)
    assert found.activation_sigma_j_mol == ACTIVATION_SIGMA_J_MOL
    assert found.drop_error(25.0) < 0.01 < 0.2 < found.drop_error(0.0)


def test_beyond_the_tests_the_cell_goes_on_with_its_own_activation_energy_and_is_surer_of_it():
    found = solution([0.0, 25.0], [1.4, 1.0])
    energy, sigma = activation_energy(found, CAPACITY_AH)
    measured = DEFAULT_ACTIVATION_J_MOL + np.log(1.4) * GAS_CONSTANT / (1 / KELVIN - 1 / (KELVIN + 25.0))
    assert DEFAULT_ACTIVATION_J_MOL < energy < measured
    assert sigma < ACTIVATION_SIGMA_J_MOL
    cell = model(found, recording(0.0), recording(25.0))
    at = {degc: float(cell.parameters(0.5, degc)[0]) for degc in (-20.0, 0.0, 25.0)}
    assert at[0.0] == pytest.approx(1.4 * 0.02 * np.exp(DEFAULT_ACTIVATION_J_MOL / GAS_CONSTANT * 3.0704e-4), rel=1e-3)
    assert np.log(at[-20.0] / at[0.0]) == pytest.approx(energy / GAS_CONSTANT * 2.8925e-4, rel=1e-3)
    assert cell.drop_error(0.0) == cell.drop_error(25.0) == 0.0
    assert cell.drop_error(-20.0) > cell.drop_error(12.0) > 0.0


def test_the_open_circuit_voltage_of_the_cold_is_a_shift_of_the_slow_tests_curve():
    found = solution([0.0, 25.0], [1.0, 1.0], [-0.03, 0.002])
    cell = model(found, recording(0.0), recording(25.0))
    assert cell.open_circuit_voltage(0.5, 25.0) == pytest.approx(3.522, abs=1e-3)
    assert cell.open_circuit_voltage(0.5, 0.0) == pytest.approx(3.49, abs=1e-3)
    shift = ocv_shift(found, 25.0)(np.array([0.5, 0.5]), np.array([0.0, np.nan]))
    np.testing.assert_allclose(shift, [-0.032, 0.0], atol=1e-9)
