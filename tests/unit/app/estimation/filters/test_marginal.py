"""The update: nearer to the truth, never surer than the evidence, hard to fool."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.inputs import InputGuard
from app.estimation.filters.marginal import SOC_MAX, SOC_MIN, MarginalFilter
from app.estimation.filters.sigma_points import central_difference, unscented
from app.estimation.filters.start import start_from_voltage
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning

CELL = PackedCell(load_cell("samsung-25r-10p"))
DIM = 1 + CELL.model.n_rc
RULES = {"ekf": None, "ukf": unscented(DIM), "cdkf": central_difference(DIM)}
TUNING = Tuning()


class Bench:
    """Cells that start at a SOC with a sigma and hear voltages at rest."""

    def __init__(self, soc, sigma=0.05, rule=RULES["cdkf"]):
        soc = np.atleast_1d(soc)
        self.n = soc.size
        self.states = CellStates(CELL.model.n_rc, self.n)
        self._guard = InputGuard(CELL, self.states, TUNING)
        rest = self._guard.check(0.0, 0.0, CELL.ocv_of(soc), np.full(self.n, 25.0))
        start_from_voltage(CELL, self.states, TUNING, rest)
        self.states.mean[SOC] = soc
        self.states.cov[:] = 0.0
        for k, own in enumerate((sigma**2, *np.full(CELL.model.n_rc, 1.0))):
            self.states.cov[k, k] = own
        self._filter = MarginalFilter(CELL, self.states, rule, TUNING)
        self.rows = np.empty((3, self.n))

    def hear(self, volts, dt_s=1.0):
        sample = self._guard.check(dt_s, 0.0, np.broadcast_to(volts, (self.n,)), np.full(self.n, 25.0))
        return self._filter.update(sample, *self.rows)


@pytest.mark.parametrize("name", RULES)
def test_a_voltage_draws_the_charge_towards_it_and_makes_it_surer(name):
    bench = Bench([0.5, 0.5], rule=RULES[name])
    before = bench.states.cov[SOC, SOC].copy()
    bench.hear(CELL.ocv_of(np.array([0.56, 0.44])))
    assert 0.5 < bench.states.mean[SOC, 0] < 0.56
    assert 0.44 < bench.states.mean[SOC, 1] < 0.5
    assert (bench.states.cov[SOC, SOC] < before).all()


def test_a_missing_voltage_changes_nothing():
    bench = Bench([0.5, 0.5])
    before = bench.states.gaussian.copy()
    accepted = bench.hear(np.array([np.nan, CELL.ocv_of(np.array([0.55]))[0]]))
    assert accepted.tolist() == [False, True]
    np.testing.assert_array_equal(bench.states.gaussian[..., 0], before[..., 0])
    assert np.isnan(bench.rows[1, 0])


def test_an_outlier_is_refused_and_what_stays_is_believed_in_the_end():
    bench = Bench(0.5, sigma=0.01)
    far = CELL.ocv_of(np.array([0.9]))[0]
    assert not bench.hear(far).any()
    assert bench.states.mean[SOC, 0] == 0.5
    for _ in range(300):
        bench.hear(far)
    assert bench.states.mean[SOC, 0] == pytest.approx(0.9, abs=0.05)


def test_a_lone_outlier_leaves_no_trace():
    bench = Bench(0.5, sigma=0.01)
    near = CELL.ocv_of(np.array([0.5]))[0]
    bench.hear(near + 0.3)
    bench.hear(near)
    assert bench.states.refused_s[0] == 0.0
    assert bench.states.mean[SOC, 0] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("volts", [0.6, 5.9])
def test_the_charge_stays_within_its_bounds(volts):
    bench = Bench(0.5, sigma=0.4)
    for _ in range(50):
        bench.hear(volts, dt_s=60.0)
        assert SOC_MIN <= bench.states.mean[SOC, 0] <= SOC_MAX
        assert np.linalg.eigvalsh(bench.states.cov[:, :, 0]).min() > 0.0
