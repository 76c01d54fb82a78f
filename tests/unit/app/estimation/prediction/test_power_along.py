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


def along(at, sigma=0.01, cell=CELL, horizons_s=(1.0, 10.0, 30.0), scale=None):
    found = power_along(cell, at, np.full(at.n_cells, sigma), scale, horizons_s)
    return {(each.direction, each.horizon_s): each for each in found}


def some_rows(n=40):
    at = states()
    return at.of(np.linspace(0, at.n_cells - 1, n).astype(int))


def test_longer_is_never_more():
    found = along(some_rows())
    for direction in ("discharge", "charge"):
        one, ten, thirty = (found[direction, seconds] for seconds in (1.0, 10.0, 30.0))
        assert (one.current_a >= ten.current_a * (1 - 1e-3)).all()
        assert (ten.current_a >= thirty.current_a * (1 - 1e-3)).all()


def test_the_median_lies_in_its_band_and_a_surer_soc_has_a_narrower_one():
    sure, unsure = along(some_rows(), 0.005), along(some_rows(), 0.05)
    for key, each in sure.items():
        for found in (each, unsure[key]):
            assert (found.low_w <= found.power_w).all()
            assert (found.power_w <= found.high_w).all()
            assert (found.low_w >= 0.0).all()
        assert ((each.high_w - each.low_w).mean()) <= (unsure[key].high_w - unsure[key].low_w).mean()


def test_a_wider_voltage_error_lowers_what_can_be_promised():
    at = some_rows()
    usual, wide = along(at), along(at, scale=np.full(at.n_cells, 4.0))
    for key, each in usual.items():
        assert (wide[key].low_w <= each.low_w * (1 + 1e-3)).all()


def test_an_empty_cell_gives_nothing_and_a_full_one_takes_nothing():
    degc, rest = np.full(1, 25.0), np.zeros((CELL.n_rc, 1))
    empty = along(OperatingPoint(np.array([0.0]), rest, degc))
    full = along(OperatingPoint(np.array([1.0]), rest, degc))
    usual = along(OperatingPoint(np.array([0.6]), rest, degc))
    assert empty["discharge", 30.0].power_w[0] < 0.05 * usual["discharge", 30.0].power_w[0]
    assert full["charge", 30.0].power_w[0] < 0.1 * usual["charge", 30.0].power_w[0]


def test_a_cell_at_its_highest_temperature_gives_nothing():
    degc = np.array([limits_of(CELL).temperature_max_degc + 1.0])
    found = along(OperatingPoint(np.array([0.6]), np.zeros((CELL.n_rc, 1)), degc))
    assert found["discharge", 10.0].power_w[0] == pytest.approx(0.0, abs=1.0)


def test_the_limits_are_those_of_the_file_and_where_it_is_silent_the_widest_there_are():
    said = CellLimits(discharge_max_a=200.0, charge_max_a=40.0, temperature_max_degc=55.0)
    known = limits_of(replace(CELL, limits=said))
    assert (known.discharge_max_a, known.charge_max_a, known.temperature_max_degc) == (200.0, 40.0, 55.0)
    silent = limits_of(replace(CELL, limits=CellLimits()))
    assert silent.discharge_max_a == silent.charge_max_a == 50.0 * CELL.capacity_ah
    assert silent.temperature_max_degc == 60.0
    assert (silent.v_min_v, silent.v_max_v) == (CELL.v_min_v, CELL.v_max_v)


def test_rc_currents_are_those_of_the_circuit_step_by_step():
    """The exact solution for a held current, on uneven steps."""
    rng = np.random.default_rng(3)
    step_s, current_a = rng.uniform(0.05, 5.0, 50), rng.normal(0.0, 60.0, 50)
    soc, degc = np.full(50, 0.5), np.full(50, 25.0)
    tau_s = CELL.parameters(0.5, 25.0)[2 + CELL.n_rc :]
    expected = np.zeros(CELL.n_rc)
    found = branch_currents(CELL, step_s, current_a, soc, degc)
    for k in range(50):
        share = np.exp(-step_s[k] / tau_s)
        expected = share * expected + (1 - share) * current_a[k]
        assert found[:, k] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_voltage_is_foretold_from_no_row_that_is_much_older_than_asked():
    time_s, current_a, _, _, voltage_v = drive()
    at = states()
    gap = time_s.size // 2
    later_s = np.where(np.arange(time_s.size) >= gap, time_s + 300.0, time_s)
    foretold = voltage_ahead(CELL, later_s, current_a, voltage_v, at, np.full(at.n_cells, 0.01))
    after = slice(gap, gap + 15)
    assert np.isnan(foretold.voltage_v[after]).all()
    assert np.isfinite(foretold.voltage_v[gap - 1])
    assert np.isfinite(foretold.voltage_v[-1])
