"""Analytic limits of the cells: the model against closed forms, not against itself."""

import math

import numpy as np
import pytest

from simulator.cell import CellArray
from simulator.cell_data import SAMSUNG_25R_10P, CellModel, Table, warburg_ladder

FLAT = (0.0, 1.0)


def plain_cell(**changes) -> CellModel:
    """A cell with constant parameters: 3.0..4.0 V straight, 2 mohm, one pair of 1 mohm and 10 s, no hysteresis."""
    values = {
        "name": "plain",
        "capacity_ah": 10.0,
        "ocv_v": Table((-0.1, 1.1), (2.9, 4.1)),
        "entropy_v_per_k": Table(FLAT, (0.0, 0.0)),
        "ohmic_ohm": Table(FLAT, (2e-3, 2e-3)),
        "charge_transfer_ohm": Table(FLAT, (0.0, 0.0)),
        "rc_ohm": (Table(FLAT, (1e-3, 1e-3)),),
        "rc_f": (1e4,),
    }
    return CellModel(**(values | changes))


@pytest.mark.parametrize("dt_s", [0.001, 0.1, 7.0, 60.0])
def test_constant_current_gives_the_closed_form_at_any_step(dt_s):
    cells = CellArray(plain_cell(), 2)
    cells.rest_at(0.8)
    current = np.array([20.0, -5.0])
    n = max(1, round(60.0 / dt_s)) if dt_s >= 0.1 else 1000
    for _ in range(n):
        cells.step(dt_s, current)
    t = n * dt_s
    soc = 0.8 - current * t / 36000.0
    expected = 3.0 + soc - 2e-3 * current - 1e-3 * current * (1 - math.exp(-t / 10.0))
    np.testing.assert_allclose(cells.voltage_v, expected, atol=1e-9)
    np.testing.assert_allclose(cells.soc, soc, atol=1e-12)


def test_resting_cell_stays_where_it_is():
    cells = CellArray(SAMSUNG_25R_10P, 3)
    cells.rest_at(np.array([0.1, 0.5, 0.9]))
    before = cells.voltage_v.copy()
    cells.step(1e6, np.zeros(3))
    np.testing.assert_array_equal(cells.voltage_v, before)


def test_charge_transfer_is_the_inverse_of_butler_volmer():
    ohm = 5e-3
    cells = CellArray(plain_cell(charge_transfer_ohm=Table(FLAT, (ohm, ohm))), 1)
    cells.rest_at(0.5)
    thermal_v = 8.314462618 * 298.15 / 96485.33212
    exchange_a = thermal_v / ohm
    current_a = 80.0
    cells.step(0.0, np.array([current_a]))
    overpotential_v = cells.ocv_v[0] - cells.voltage_v[0] - 2e-3 * current_a
    # symmetric Butler-Volmer: i = 2 i0 sinh(eta / (2 V_T))
    assert 2 * exchange_a * math.sinh(overpotential_v / (2 * thermal_v)) == pytest.approx(current_a, rel=1e-9)


def test_ladder_follows_the_diffusion_law():
    """Short times: v = 2 R i sqrt(t / pi tau). Long times: v = R i."""
    pairs, farads = warburg_ladder(Table(FLAT, (1e-3, 1e-3)), diffusion_s=100.0, pairs=12)
    model = plain_cell(ohmic_ohm=Table(FLAT, (0.0, 0.0)), rc_ohm=pairs, rc_f=farads, capacity_ah=1e9)
    cells = CellArray(model, 1)
    cells.rest_at(0.5)
    start_v = float(cells.voltage_v[0])
    cells.step(9.0, np.array([10.0]))
    assert start_v - cells.voltage_v[0] == pytest.approx(2 * 0.01 * math.sqrt(9.0 / (math.pi * 100.0)), rel=0.02)
    cells.step(1e4, np.array([10.0]))
    assert start_v - cells.voltage_v[0] == pytest.approx(0.01, rel=1e-5)


def test_hysteresis_reaches_each_branch_and_returns_by_the_charge_that_turns_it():
    model = plain_cell(hysteresis_v=0.02, hysteresis_soc=0.02)
    cells = CellArray(model, 1)
    cells.rest_at(0.5)
    turning_s = 0.02 * 36000.0 / 10.0
    cells.step(10 * turning_s, np.array([10.0]))
    assert cells.hysteresis_v[0] == pytest.approx(-0.02, rel=1e-3)
    cells.step(turning_s, np.array([-10.0]))
    assert cells.hysteresis_v[0] == pytest.approx(0.02 - 0.04 * math.exp(-1.0), rel=1e-3)
    cells.step(1e5, np.array([0.0]))
    assert cells.hysteresis_v[0] == pytest.approx(0.02 - 0.04 * math.exp(-1.0), rel=1e-3)


def test_charge_balances_and_efficiency_is_lost_in_charging_only():
    model = plain_cell(coulombic_efficiency=0.99)
    cells = CellArray(model, 1)
    cells.rest_at(0.5)
    for _ in range(1000):
        cells.step(1.0, np.array([5.0]))
    assert cells.soc[0] == pytest.approx(0.5 - 5000.0 / 36000.0, rel=1e-12)
    for _ in range(1000):
        cells.step(1.0, np.array([-5.0]), is_charging=True)
    assert cells.soc[0] == pytest.approx(0.5 - 0.01 * 5000.0 / 36000.0, rel=1e-12)


def integrate(cells: CellArray, current_a: float, seconds: float, dt_s: float, *, is_charging: bool) -> float:
    """Step at constant current and return the terminal energy of cell 0 by the trapezoidal rule [J]."""
    current = np.full(cells.n_cells, current_a)
    cells.step(0.0, current, is_charging=is_charging)
    energy_j, before_v = 0.0, float(cells.voltage_v[0])
    for _ in range(round(seconds / dt_s)):
        cells.step(dt_s, current, is_charging=is_charging)
        energy_j += 0.5 * (before_v + float(cells.voltage_v[0])) * current_a * dt_s
        before_v = float(cells.voltage_v[0])
    return energy_j


def test_energy_balances_through_discharge_charge_and_rest():
    """Chemical energy given = work at the terminals + heat + what pairs and hysteresis hold."""
    cells = CellArray(SAMSUNG_25R_10P, 1)
    cells.rest_at(0.8)
    chemical_j, stored_j = cells.chemical_energy_j()[0], cells.stored_energy_j()[0]
    work_j, moved_j = 0.0, 0.0
    for current_a, seconds in ((100.0, 40.0), (-40.0, 30.0), (0.0, 30.0), (200.0, 10.0), (-100.0, 60.0)):
        part_j = integrate(cells, current_a, seconds, 0.02, is_charging=current_a < 0.0)
        work_j += part_j
        moved_j += abs(part_j)
    heat_j = cells.take_heat_j()[0]
    given_j = chemical_j - cells.chemical_energy_j()[0]
    held_j = cells.stored_energy_j()[0] - stored_j
    assert heat_j > 0.0
    assert given_j == pytest.approx(work_j + heat_j + held_j, abs=1e-6 * moved_j)


def test_a_closed_charge_loop_only_loses():
    cells = CellArray(SAMSUNG_25R_10P, 1)
    cells.rest_at(0.5)
    start_j = cells.chemical_energy_j()[0]
    rng = np.random.default_rng(5)
    for current_a in rng.uniform(-200.0, 200.0, 300):
        cells.step(3.0, np.array([current_a]))
        held = cells.stored_energy_j()[0]
        heat = cells.take_heat_j()[0]
        assert held >= 0.0
        assert heat >= -1e-9
    assert cells.chemical_energy_j()[0] != start_j


@pytest.mark.parametrize("dt_s", [0.0, 1e-4, 1.0, 1e3, 1e6])
def test_no_step_length_makes_anything_infinite(dt_s):
    cells = CellArray(SAMSUNG_25R_10P, 2)
    cells.rest_at(0.5)
    for current_a in (50.0, -50.0, 400.0, 0.0):
        cells.step(dt_s, np.full(2, current_a))
        assert np.all(np.isfinite(cells.voltage_v))
        assert np.all(np.abs(cells.voltage_v) < 10.0)


def pulse_ohm(soc: float, degc: float, seconds: float, current_a: float = 25.0) -> float:
    """Resistance that a pulse test would find [ohm]."""
    cells = CellArray(SAMSUNG_25R_10P, 1)
    cells.rest_at(soc)
    cells.refresh(np.array([degc]), np.array([25.5]), np.ones(1))
    before = cells.voltage_v[0]
    cells.step(seconds, np.array([current_a]))
    return float((before - cells.voltage_v[0]) / current_a)


def test_module_resistances_are_those_of_ten_25r_in_parallel():
    assert 1.5e-3 < pulse_ohm(0.5, 25.0, 0.1) < 1.8e-3
    public_mohm = {0.05: 42, 0.1: 36, 0.2: 30, 0.3: 26, 0.4: 24, 0.5: 22, 0.7: 22, 0.8: 23, 0.9: 25, 1.0: 30}
    for soc, mohm in public_mohm.items():
        assert pulse_ohm(soc, 25.0, 10.0) == pytest.approx(mohm * 1e-4, rel=0.15), soc


def test_cold_raises_and_warmth_lowers_resistance_as_measured_nmc_does():
    assert 1.2 < pulse_ohm(0.5, 5.0, 0.1) / pulse_ohm(0.5, 20.0, 0.1) < 1.6
    assert 0.5 < pulse_ohm(0.5, 40.0, 10.0) / pulse_ohm(0.5, 20.0, 10.0) < 0.9


def test_ocv_rises_everywhere():
    grid = np.linspace(-0.09, 1.09, 2000)
    assert np.all(np.diff(SAMSUNG_25R_10P.ocv_v.at(grid)) > 0.0)
