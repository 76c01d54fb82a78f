import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
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
