"""Analytic limits of the thermal network."""

import numpy as np
import pytest

from simulator.thermal import ThermalNetwork, ThermalParameters, decay_and_integral

SEALED = ThermalParameters(natural_w_per_k=0.0, board_to_air_w_per_k=0.0)


def network(n_cells: int, parameters: ThermalParameters, ambient_degc: float = 25.0) -> ThermalNetwork:
    return ThermalNetwork(parameters, np.full(n_cells, 480.0), ambient_degc)


def energy_j(heat: ThermalNetwork) -> float:
    return float((heat.heat_capacity_j_per_k * heat.node_degc).sum())


@pytest.mark.parametrize("dt_s", [0.1, 1.0, 600.0, 1e5])
def test_without_ways_out_all_heat_stays(dt_s):
    heat = network(96, SEALED)
    before = energy_j(heat)
    watts = np.random.default_rng(1).uniform(0.0, 20.0, 104)
    for _ in range(20):
        heat.step(dt_s, watts, 25.0, 0.0)
    assert energy_j(heat) - before == pytest.approx(20 * dt_s * watts.sum(), rel=1e-6)


def test_even_heating_of_sealed_cells_is_adiabatic():
    heat = network(24, ThermalParameters(natural_w_per_k=0.0, board_to_cell_w_per_k=0.0))
    heat.step(300.0, np.concatenate((np.full(24, 8.0), np.zeros(2))), 25.0, 0.0)
    np.testing.assert_allclose(heat.cell_degc, 25.0 + 8.0 * 300.0 / 480.0, rtol=1e-9)


def test_two_cells_exchange_heat_exponentially():
    parameters = ThermalParameters(
        cells_per_pack=2, natural_w_per_k=0.0, board_to_cell_w_per_k=0.0, across_rows_w_per_k=0.5
    )
    heat = network(2, parameters)
    heat.node_degc[:2] = (40.0, 20.0)
    heat.step(400.0, np.zeros(3), 25.0, 0.0)
    difference = 20.0 * np.exp(-2 * 0.5 / 480.0 * 400.0)
    np.testing.assert_allclose(heat.cell_degc, (30.0 + difference / 2, 30.0 - difference / 2), rtol=1e-9)


def test_step_length_does_not_matter():
    one, many = network(96, ThermalParameters()), network(96, ThermalParameters())
    watts = np.linspace(0.0, 12.0, 104)
    one.step(500.0, watts, 20.0, 0.5)
    for _ in range(500):
        many.step(1.0, watts, 20.0, 0.5)
    np.testing.assert_allclose(one.node_degc, many.node_degc, rtol=1e-9)


def test_in_the_end_what_goes_in_goes_out():
    """Steady state: heat in = conductance to ambient times temperature rise, summed over the walls and the air."""
    heat = network(96, ThermalParameters())
    watts = np.concatenate((np.full(96, 8.0), np.zeros(8)))
    heat.step(1e6, watts, 20.0, 1.0)
    leaving = heat.conductance_w_per_k(1.0) @ (heat.node_degc - 20.0)
    np.testing.assert_allclose(leaving, watts, atol=1e-6)


def test_air_warms_along_the_pack_and_the_second_pack_breathes_it():
    heat = network(96, ThermalParameters())
    heat.step(1e5, np.concatenate((np.full(96, 8.0), np.zeros(8))), 20.0, 0.6)
    first_row = heat.cell_degc[:6]
    assert np.all(np.diff(first_row) > 0.0)
    assert heat.cell_degc[48] > heat.cell_degc[5]


def test_more_fan_is_cooler_and_none_is_hottest():
    hottest = []
    for duty in (0.0, 0.25, 0.5, 1.0):
        heat = network(96, ThermalParameters())
        heat.step(1e5, np.concatenate((np.full(96, 8.0), np.zeros(8))), 20.0, duty)
        hottest.append(heat.cell_degc.max())
    assert hottest == sorted(hottest, reverse=True)


def test_bleeding_board_warms_the_cells_beside_it_only():
    heat = network(24, ThermalParameters())
    watts = np.zeros(26)
    watts[24] = 8.0
    heat.step(3600.0, watts, 25.0, 0.0)
    assert heat.board_degc[0] > heat.cell_degc[:12].max() > 25.5
    np.testing.assert_allclose(heat.cell_degc[12:], 25.0)


def test_matrix_exponential_equals_its_eigenvalue_form():
    rng = np.random.default_rng(3)
    basis = rng.standard_normal((5, 5))
    rates = np.array([1e-4, 0.01, 0.3, 2.0, 40.0])
    inverse = np.linalg.inv(basis)
    decay, integral = decay_and_integral(basis @ np.diag(rates) @ inverse, 3.0)
    np.testing.assert_allclose(decay, basis @ np.diag(np.exp(-3.0 * rates)) @ inverse, atol=1e-10)
    np.testing.assert_allclose(integral, basis @ np.diag((1 - np.exp(-3.0 * rates)) / rates) @ inverse, atol=1e-9)
