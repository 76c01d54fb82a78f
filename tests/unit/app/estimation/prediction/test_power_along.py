from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import CellLimits
from app.estimation.prediction.constant_current import CellKnowledge, OperatingPoint
from app.estimation.prediction.power import PowerModel
from app.estimation.prediction.power_along import branch_currents, limits_of, power_along, voltage_ahead
from tests.open_loop import simulate

CELL = load_cell("samsung-25r-10p")


def drive(seconds=600, seed=1):
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, seconds, 0.5)
    current_a = np.repeat(rng.choice([0.0, 30.0, 90.0, -20.0], time_s.size // 20 + 1), 20)[: time_s.size]
    degc = np.full(time_s.size, 25.0)
    soc, voltage_v = simulate(CELL, time_s, current_a, degc, 0.8)
    return time_s, current_a, degc, soc, voltage_v


def states():
    time_s, current_a, degc, soc, _ = drive()
    return OperatingPoint(soc, branch_currents(CELL, np.diff(time_s, prepend=0.0), current_a, soc, degc), degc)


def test_every_row_is_what_the_power_model_says_of_it_alone():
    at = states()
    sigma = np.full(at.n_cells, 0.02)
    rows = (0, 500, at.n_cells - 1)
    found = {(each.direction, each.horizon_s): each for each in power_along(CELL, at, sigma)}
    for row in rows:
        known = CellKnowledge(sigma[[row]], capacity_sigma_frac=0.02)
        power, _ = PowerModel(CELL, limits_of(CELL), known).predict(at.of([row]), ())
        for alone in power.discharge:
            along = found["discharge", alone.horizon_s]
            assert along.power_w[row] == pytest.approx(alone.power_w, rel=0.002)
            assert along.low_w[row] == pytest.approx(alone.low_w, rel=0.005)
            assert along.high_w[row] == pytest.approx(alone.high_w, rel=0.005)
            assert not along.beyond_measured[row]


def test_without_a_largest_current_the_voltage_limits_and_what_was_not_measured_is_marked():
    cell = replace(CELL, limits=CellLimits(), fit_current_max_a=50.0)
    for each in power_along(cell, states(), np.full(states().n_cells, 0.01), horizons_s=(10.0,)):
        if each.direction == "discharge":
            assert each.beyond_measured.all()
            assert each.power_w == pytest.approx(cell.v_min_v * each.current_a, rel=0.02)


def test_the_voltage_ahead_is_that_of_the_circuit_under_the_current_that_flowed():
    time_s, current_a, _, _, voltage_v = drive()
    at = states()
    foretold = voltage_ahead(CELL, time_s, current_a, voltage_v, at, np.full(at.n_cells, 0.01))
    assert np.isnan(foretold.voltage_v[0])
    known = np.isfinite(foretold.voltage_v)
    assert known.mean() > 0.95
    np.testing.assert_allclose(foretold.voltage_v[known], voltage_v[known], atol=5e-3)
    assert (np.abs(foretold.voltage_v - voltage_v) <= foretold.half_band_v)[known].all()


def test_rc_pairs_relax_over_a_hole():
    soc, degc = np.full(3, 0.5), np.full(3, 25.0)
    branches = branch_currents(CELL, np.array([0.0, 10.0, 1e5]), np.full(3, 80.0), soc, degc)
    assert (branches[:, 1] > 0.0).all()
    np.testing.assert_allclose(branches[:, 2], 0.0, atol=1e-6)
