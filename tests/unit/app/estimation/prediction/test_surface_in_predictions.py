"""Power, times and energy read the OCV at the surface, which is emptier than the cell after a load."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.prediction.constant_current import CellKnowledge, Limits, OperatingPoint
from app.estimation.prediction.energy import energy_left
from app.estimation.prediction.power import PowerModel

CELL = load_cell("panasonic-ncr18650pf")
LOADED_A = 2.0 * CELL.capacity_ah
LIMITS = Limits(v_min_v=2.5, v_max_v=4.2, discharge_max_a=100.0, charge_max_a=50.0, heat_capacity_j_k=np.inf)


def predicted(soc, degc, loaded_a):
    """Power of 10 s, its lower end, seconds to the lowest voltage at 1C and energy left at 1C."""
    lags = np.full((CELL.n_rc, 1), loaded_a)
    states = OperatingPoint(np.array([soc]), lags, np.array([degc]))
    model = PowerModel(CELL, LIMITS, CellKnowledge(soc_sigma=np.array([0.01])))
    power, (trips,) = model.predict(states, (CELL.capacity_ah,))
    left = energy_left(
        CELL,
        np.array([soc]),
        np.array([0.01]),
        np.array([degc]),
        CELL.capacity_ah,
        v_min_v=LIMITS.v_min_v,
        branch_a=lags,
    )
    return power.discharge[1].power_w, power.discharge[1].low_w, trips[0].seconds, left.energy_wh


@pytest.mark.parametrize(("soc", "degc"), [(0.5, 25.0), (0.3, 0.0), (0.1, 25.0), (0.15, -10.0)])
def test_after_a_load_all_of_them_are_less(soc, degc):
    assert all(
        tired < fresh for tired, fresh in zip(predicted(soc, degc, LOADED_A), predicted(soc, degc, 0.0), strict=True)
    )


@pytest.mark.parametrize("loaded_a", [0.0, LOADED_A])
def test_in_the_cold_all_of_them_are_less(loaded_a):
    warm, cold = predicted(0.3, 25.0, loaded_a), predicted(0.3, -10.0, loaded_a)
    assert all(less < more for less, more in zip(cold, warm, strict=True))


def test_near_empty_the_load_before_takes_more_of_the_power_than_at_half_charge():
    half, empty = (predicted(soc, 25.0, LOADED_A)[0] / predicted(soc, 25.0, 0.0)[0] for soc in (0.5, 0.08))
    assert empty < half
