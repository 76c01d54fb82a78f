"""The tables say what the cell model says, everywhere, and stay finite outside."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.tables import (
    COLD,
    DROP_ERROR,
    LASTING_DROP,
    LASTING_OHM,
    LASTING_S,
    OCV,
    OVERPOTENTIAL,
    R0,
    R1,
    SOC_LOW,
    SOC_STEP,
    CellTables,
)

MODEL = load_cell("samsung-25r-10p")
OVER = replace(MODEL, overpotential_v=np.full(MODEL.r0_ohm.shape, 0.01), overpotential_current_a=25.0)
MOVING = replace(MODEL, tau_s=MODEL.tau_s * np.linspace(0.8, 1.2, MODEL.soc_grid.size))
RNG = np.random.default_rng(4)
SOC = RNG.uniform(0.0, 1.0, 200)
DEGC = RNG.uniform(MODEL.temperature_grid_degc[0] - 20.0, MODEL.temperature_grid_degc[-1] + 20.0, 200)


def test_ocv_slope_and_inverse_are_the_models():
    cell = CellTables(MODEL)
    np.testing.assert_allclose(cell.ocv(SOC), MODEL.ocv.voltage(SOC), atol=1e-4)
    np.testing.assert_allclose(cell.ocv_slope(SOC), MODEL.ocv.slope(SOC), rtol=0.02, atol=0.02)
    np.testing.assert_allclose(cell.soc_of_ocv(cell.ocv(SOC)), SOC, atol=1e-9)
    assert cell.soc_of_ocv(np.array([0.0, 9.0])).tolist() == [-0.05, 1.05]
    assert np.isnan(cell.soc_of_ocv(np.array([np.nan]))).all()


@pytest.mark.parametrize("model", [MODEL, OVER, MOVING])
def test_parameters_are_the_models_at_any_soc_and_temperature(model):
    cell = CellTables(model)
    at = cell.place_temperature(DEGC)
    found, expected = cell.circuit(SOC, at), model.parameters(SOC, DEGC)
    np.testing.assert_allclose(found[OCV], cell.ocv(SOC), atol=1e-12)
    np.testing.assert_allclose(found[[R0, OVERPOTENTIAL]], expected[:2], rtol=1e-3)
    np.testing.assert_allclose(found[R1:-1], expected[2 : 2 + model.n_rc], rtol=1e-3)
    np.testing.assert_array_equal(found[-1], LASTING_OHM)
    tau_s = cell.time_constants(SOC, at)
    np.testing.assert_allclose(tau_s[:-1], expected[2 + model.n_rc :], rtol=1e-3)
    np.testing.assert_array_equal(tau_s[-1], LASTING_S)


def test_slopes_of_the_resistances_are_their_differences():
    cell = CellTables(MODEL)
    at, inside = cell.place_temperature(DEGC), np.clip(SOC, 0.01, 0.99)
    j, _ = cell.place_soc(inside)
    here, next_ = (cell.circuit(cell.soc[j] + k * SOC_STEP, at) for k in (0, 1))
    np.testing.assert_allclose(cell.circuit_slope(inside, at)[R0:], ((next_ - here) / SOC_STEP)[R0:], atol=1e-9)
    np.testing.assert_allclose(cell.circuit_slope(inside, at)[OCV], cell.ocv_slope(inside))


@pytest.mark.parametrize("soc", [-5.0, SOC_LOW, 1.1, 9.0])
def test_values_hold_at_the_ends(soc):
    cell = CellTables(MODEL)
    end = cell.soc[0] if soc < 0.5 else cell.soc[-1]
    cold, warm = (cell.place_temperature(np.array([degc])) for degc in (-300.0, 300.0))
    assert cell.ocv(np.array([soc])) == cell.ocv(np.array([end]))
    for at, degc in ((cold, MODEL.temperature_grid_degc[0]), (warm, MODEL.temperature_grid_degc[-1])):
        held = cell.circuit(np.array([end]), cell.place_temperature(np.array([degc])))
        np.testing.assert_allclose(cell.circuit(np.array([soc]), at), held, rtol=1e-12)


def test_one_temperature_and_fixed_time_constants_are_recognised():
    single = CellTables(
        replace(
            MODEL,
            temperature_grid_degc=[25.0],
            r0_ohm=MODEL.r0_ohm[3:4],
            r_ohm=MODEL.r_ohm[:, 3:4],
            tau_s=MODEL.tau_s[:, 3:4],
            overpotential_v=None,
        )
    )
    found = single.circuit(SOC, single.place_temperature(DEGC))
    np.testing.assert_allclose(found[R0], single.model.parameters(SOC, 25.0)[0], rtol=1e-3)
    assert not single.has_overpotential
    assert not single.has_tau_table
    assert CellTables(OVER).has_overpotential
    assert CellTables(MOVING).has_tau_table


def test_a_coarser_grid_stays_near():
    coarse = CellTables(MODEL, soc_step=0.01)
    assert coarse.soc.size == 121
    np.testing.assert_allclose(coarse.ocv(SOC), MODEL.ocv.voltage(SOC), atol=0.01)


def test_an_open_circuit_voltage_that_depends_on_temperature_has_its_inverse_there():
    grid = MODEL.temperature_grid_degc
    shift_v = np.outer((grid - 25.0) * 1e-3, np.ones(MODEL.soc_grid.size))
    cell = CellTables(replace(MODEL, ocv_shift_v=shift_v))
    inside = np.linspace(0.05, 0.95, 10)
    for degc in (float(grid[0]), float(grid[-1])):
        at = cell.place_temperature(np.full(inside.shape, degc))
        expected_v = MODEL.ocv.voltage(inside) + (degc - 25.0) * 1e-3
        np.testing.assert_allclose(cell.ocv(inside, at), expected_v, atol=1e-4)
        np.testing.assert_allclose(cell.soc_of_ocv(cell.ocv(inside, at), at), inside, atol=1e-9)


def test_the_uncertainty_is_the_models_at_any_temperature():
    model = replace(MODEL, fit_temperature_degc=np.array([20.0, 30.0]))
    cell = CellTables(model)
    degc = np.array([-20.0, 0.0, 25.0, 45.0])
    uncertainty = cell.uncertainty_at(degc)
    np.testing.assert_allclose(uncertainty[DROP_ERROR], model.drop_error(degc), atol=1e-9)
    np.testing.assert_allclose(uncertainty[LASTING_DROP], model.lasting_ohm(degc), rtol=1e-9)
    assert uncertainty[COLD].tolist() == sorted(uncertainty[COLD], reverse=True)
    assert uncertainty[COLD][2] == uncertainty[COLD][3] == 1.0
    assert np.isfinite(cell.uncertainty_at(np.array([-300.0, 300.0]))).all()
