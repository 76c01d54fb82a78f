from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.evidence import Evidence
from app.estimation.errors import ModelError, ShapeError
from app.estimation.prediction.energy import (
    EnergyLeft,
    energy_left,
    laps_left,
)
from tests.open_loop import simulate

CELL = load_cell("samsung-25r-10p")


def left(soc=0.6, sigma=0.01, current_a=0.0, n=96, **more):
    soc = np.broadcast_to(np.asarray(soc, dtype=float), (n,)).copy()
    return energy_left(CELL, soc, np.full(n, sigma), np.full(n, 25.0), current_a, **more)


def test_energy_without_current_is_the_integral_of_the_ocv():
    grid = np.linspace(0.0, 0.6, 2001)
    expected = 96 * CELL.capacity_ah * np.trapezoid(CELL.ocv.voltage(grid), grid)
    assert left().energy_wh == pytest.approx(expected, rel=1e-3)
    assert left().charge_ah == pytest.approx(0.6 * CELL.capacity_ah)


def test_energy_at_a_current_is_what_the_circuit_delivers():
    time_s = np.arange(0.0, 0.5 * 3600 * CELL.capacity_ah / 60.0)
    soc, voltage = simulate(CELL, time_s, np.full(time_s.size, 60.0), np.full(time_s.size, 25.0), 0.6)
    assert soc[-1] == pytest.approx(0.1, abs=0.001)
    delivered = 96 * 60.0 * np.trapezoid(voltage, time_s) / 3600
    assert left(current_a=60.0, soc_min=0.1).energy_wh == pytest.approx(delivered, rel=0.01)


def test_weakest_cell_ends_it_and_its_sigma_counts():
    soc = np.full(96, 0.6)
    soc[17] = 0.3
    found = left(soc)
    assert found.cell == 17
    assert found.charge_ah == pytest.approx(0.3 * CELL.capacity_ah)
    assert left(soc, sigma=0.02).sigma_wh == pytest.approx(2 * found.sigma_wh)


def test_small_cell_ends_it_though_its_soc_is_highest():
    capacity = np.full(96, CELL.capacity_ah)
    capacity[3] *= 0.5
    assert left(capacity_ah=capacity).cell == 3


def test_cell_without_soc_is_left_out():
    soc = np.full(96, 0.6)
    soc[0] = np.nan
    assert left(soc).energy_wh == pytest.approx(left().energy_wh * 95 / 96)
    with pytest.raises(ModelError):
        left(np.nan)


def test_it_ends_where_the_load_takes_the_first_cell_to_its_lowest_voltage():
    """In the cold or near empty the voltage ends it, long before the charge does."""
    time_s = np.arange(0.0, 0.6 * 3600 * CELL.capacity_ah / 100.0)
    _, voltage = simulate(CELL, time_s, np.full(time_s.size, 100.0), np.full(time_s.size, 25.0), 0.6)
    lasts_s = float(time_s[np.argmax(voltage < 3.3)])
    found = left(current_a=100.0, v_min_v=3.3, branch_a=np.zeros((CELL.n_rc, 96)))
    assert found.charge_ah == pytest.approx(100.0 * lasts_s / 3600.0, rel=0.02)
    assert found.energy_wh < left(current_a=100.0).energy_wh
    assert left(0.05, current_a=100.0, v_min_v=3.6).energy_wh == 0.0


def test_a_load_that_was_never_measured_for_so_long_costs_more_and_is_less_sure():
    seen = replace(CELL, evidence=Evidence(held=((1.0, 200.0), (100.0, 20.0))))
    soc, degc = np.full(2, 0.6), np.full(2, 25.0)
    one, other = (energy_left(cell, soc, 0.01 * soc, degc, 60.0) for cell in (CELL, seen))
    assert (one.beyond_measured, other.beyond_measured) == (False, True)
    assert other.energy_wh < one.energy_wh
    assert other.sigma_wh > one.sigma_wh


def test_empty_has_nothing_left():
    assert left(0.05, soc_min=0.1).energy_wh == 0.0


def test_arrays_of_another_shape_are_refused():
    with pytest.raises(ShapeError):
        energy_left(CELL, np.full(96, 0.5), np.full(95, 0.01), np.full(96, 25.0), 0.0)


def test_laps_are_energy_over_mean_lap():
    found = laps_left(EnergyLeft(3000.0, 0.0, 10.0, 0), [290.0, 310.0, 300.0, 300.0])
    assert found.laps == pytest.approx(10.0)
    assert found.low < 10.0 < found.high


def test_band_holds_the_truth_nine_times_in_ten():
    rng = np.random.default_rng(4)
    inside = 0
    for _ in range(400):
        past, energy = 300 + 30 * rng.normal(size=8), 3000.0
        estimate = energy + 100.0 * rng.normal()
        found = laps_left(EnergyLeft(estimate, 100.0, 10.0, 0), past)
        used = np.cumsum(300 + 30 * rng.normal(size=40))
        done = np.interp(energy, np.concatenate(([0.0], used)), np.arange(41))
        inside += found.low <= done <= found.high
    assert 0.85 <= inside / 400 <= 0.97


def test_band_narrows_with_laps_driven():
    energy = EnergyLeft(3000.0, 30.0, 10.0, 0)
    two, many = laps_left(energy, [300.0, 301.0]), laps_left(energy, [300.0, 301.0, 299.0, 300.0, 300.0, 300.0])
    assert many.high - many.low < 0.8 * (two.high - two.low)


@pytest.mark.parametrize("laps", [[], [np.nan, 300.0], [-5.0, -5.0], [300.0]])
def test_no_lap_no_forecast(laps):
    assert laps_left(EnergyLeft(3000.0, 30.0, 10.0, 0), laps) is None


def test_an_uncertain_capacity_makes_the_energy_uncertain():
    sure, unsure = left(sigma=0.0), left(sigma=0.0, capacity_sigma_ah=0.02 * CELL.capacity_ah)
    assert sure.sigma_wh == 0.0
    assert unsure.energy_wh == sure.energy_wh
    charge_sigma_ah = 0.02 * 0.6 * CELL.capacity_ah
    assert 96 * CELL.v_min_v * charge_sigma_ah < unsure.sigma_wh < 0.02 * unsure.energy_wh, "drawn at the end"


def test_uncertain_resistances_and_the_load_to_come_widen_the_band():
    known, unknown = left(sigma=0.0, current_a=60.0), left(sigma=0.0, current_a=60.0, resistance_sigma=0.3)
    assert 0.0 < known.sigma_wh < unknown.sigma_wh
    assert unknown.low_wh < unknown.energy_wh < unknown.high_wh
    assert left(0.001, sigma=0.05).low_wh == 0.0
