"""The packed tables say what the cell model says, everywhere, and stay finite outside."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.tables import N_SOC, SOC_LOW, SOC_STEP, PackedCell

MODEL = load_cell("samsung-25r-10p")
OVER = replace(MODEL, overpotential_v=np.full(MODEL.r0_ohm.shape, 0.01), overpotential_current_a=25.0)
RNG = np.random.default_rng(4)
SOC = RNG.uniform(0.0, 1.0, 200)
DEGC = RNG.uniform(MODEL.temperature_grid_degc[0] - 20.0, MODEL.temperature_grid_degc[-1] + 20.0, 200)


def test_ocv_and_slope_are_the_models():
    cell = PackedCell(MODEL)
    j, f = cell.place_soc(SOC)
    np.testing.assert_allclose(cell.ocv_at(j, f), MODEL.ocv.voltage(SOC), atol=1e-4)
    np.testing.assert_allclose(cell.ocv_of(SOC), cell.ocv_at(j, f), atol=1e-12)
    np.testing.assert_allclose(cell.ocv_slope_at(j, f), MODEL.ocv.slope(SOC), rtol=0.02, atol=0.02)


@pytest.mark.parametrize("model", [MODEL, OVER])
def test_resistances_are_the_models_at_any_soc_and_temperature(model):
    cell = PackedCell(model)
    (j, f), (row, g) = cell.place_soc(SOC), cell.place(DEGC)
    found, expected = cell.circuit_at(j, f, row, g), model.parameters(SOC, DEGC)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-3)
    np.testing.assert_allclose(found[1 : 1 + model.n_rc], expected[2 : 2 + model.n_rc], rtol=1e-3)
    np.testing.assert_allclose(cell.tau_at(j, f, row, g), expected[2 + model.n_rc :], rtol=1e-3)
    branch = RNG.uniform(-50.0, 50.0, (model.n_rc, SOC.size))
    measured = model.terminal_voltage(SOC, branch, 80.0, DEGC)
    np.testing.assert_allclose(cell.ocv_at(j, f) - cell.drop(found, 80.0, branch), measured, atol=2e-4)


def test_slopes_of_the_resistances_are_their_differences():
    cell = PackedCell(MODEL)
    (row, g), inside = cell.place(DEGC), np.clip(SOC, 0.01, 0.99)
    j, _ = cell.place_soc(inside)
    here, next_ = (cell.circuit_at(j + k, np.zeros(SOC.size), row, g) for k in (0, 1))
    np.testing.assert_allclose(cell.circuit_slope_at(j, row, g), (next_ - here) / SOC_STEP, atol=1e-9)


@pytest.mark.parametrize("soc", [-5.0, SOC_LOW, 1.1, 9.0])
def test_values_hold_at_the_ends(soc):
    cell = PackedCell(MODEL)
    j, f = cell.place_soc(np.array([soc]))
    assert 0 <= j[0] + f[0] <= N_SOC - 1
    assert np.isfinite(cell.ocv_at(j, f)).all()
    row, g = cell.place(np.array([-300.0, 300.0]))
    held = cell.place(MODEL.temperature_grid_degc[[0, -1]])
    np.testing.assert_allclose(row + g, held[0] + held[1])


def test_one_temperature_and_fixed_time_constants_are_recognised():
    single = PackedCell(
        replace(
            MODEL,
            temperature_grid_degc=[25.0],
            r0_ohm=MODEL.r0_ohm[3:4],
            r_ohm=MODEL.r_ohm[:, 3:4],
            tau_s=MODEL.tau_s[:, 3:4],
            overpotential_v=None,
        )
    )
    j, f = single.place_soc(SOC)
    row, g = single.place(DEGC)
    np.testing.assert_allclose(single.circuit_at(j, f, row, g)[0], single.model.parameters(SOC, 25.0)[0], rtol=1e-3)
    assert not single.has_overpotential
    assert PackedCell(OVER).has_overpotential
    moving = replace(MODEL, tau_s=MODEL.tau_s * np.linspace(0.8, 1.2, MODEL.soc_grid.size))
    assert PackedCell(moving).tau_fixed_s is None
