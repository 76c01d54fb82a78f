"""Between two samples: charge moves, RC currents follow, ignorance grows and never leaves its bounds."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.inputs import InputGuard
from app.estimation.filters.process import SOC_VARIANCE_MAX, Process
from app.estimation.filters.start import start_count
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning
from tests.open_loop import simulate

MODEL = load_cell("samsung-25r-10p")
MOVING = replace(MODEL, tau_s=MODEL.tau_s * np.linspace(0.8, 1.2, MODEL.soc_grid.size))
TUNING = Tuning()


class Cell:
    """One cell that is only predicted."""

    def __init__(self, model=MODEL, soc=0.6, variance=1e-4):
        packed = PackedCell(model)
        self.states = CellStates(model.n_rc, 1)
        self.states.mean[SOC] = soc
        self.states.cov[:] = 0.0
        for k, own in enumerate((variance, *np.full(model.n_rc, 4.0))):
            self.states.cov[k, k] = own
        start_count(self.states, np.array([soc]), np.array([0.01]))
        self._guard = InputGuard(packed, self.states, TUNING)
        self._process = Process(packed, self.states, TUNING, counts=True)

    def go(self, dt_s, current_a):
        self._process.predict(self._guard.check(dt_s, current_a, [3.7], [25.0]))
        return self


def test_charge_and_rc_currents_move_as_the_circuit_says():
    current = np.repeat([60.0, 0.0, -30.0, 120.0], 50)
    time_s = np.cumsum(np.random.default_rng(2).uniform(0.05, 3.0, current.size))
    soc, _ = simulate(MODEL, time_s, current, np.full(current.size, 25.0), 0.6)
    cell = Cell()
    branch = np.zeros(MODEL.n_rc)
    for dt, i in zip(np.diff(time_s, prepend=time_s[0]), current, strict=True):
        cell.go(float(dt), float(i))
        decay = np.exp(-dt / MODEL.tau_s[:, 0, 0])
        branch = decay * branch + (1.0 - decay) * i
    assert cell.states.mean[SOC, 0] == pytest.approx(soc[-1], abs=1e-12)
    assert cell.states.count_soc[0] == pytest.approx(soc[-1], abs=1e-12)
    np.testing.assert_allclose(cell.states.mean[1:, 0], branch, atol=1e-9)


def test_charging_counts_times_the_efficiency():
    lossy = Cell(replace(MODEL, coulombic_efficiency=0.98)).go(3600.0, -0.1 * MODEL.capacity_ah)
    assert lossy.states.mean[SOC, 0] == pytest.approx(0.6 + 0.098)


@pytest.mark.parametrize("model", [MODEL, MOVING])
def test_one_long_step_is_many_short_ones(model):
    """Of held current; to first order only where time constants depend on the SOC that moves meanwhile."""
    long, short = Cell(model).go(20.0, 40.0), Cell(model)
    for _ in range(200):
        short.go(0.1, 40.0)
    np.testing.assert_allclose(long.states.mean, short.states.mean, rtol=1e-3)
    np.testing.assert_allclose(long.states.cov, short.states.cov, rtol=0.01, atol=1e-7)


def test_ignorance_grows_to_its_bound_and_stays_definite():
    cell = Cell()
    before = cell.states.cov[SOC, SOC, 0]
    assert cell.go(60.0, 0.0).states.cov[SOC, SOC, 0] > before
    for _ in range(300):
        cell.go(86_400.0, 50.0)
    assert cell.states.cov[SOC, SOC, 0] <= SOC_VARIANCE_MAX * (1 + 1e-9)
    assert (np.linalg.eigvalsh(cell.states.cov[:, :, 0]) > 0.0).all()


def test_hysteresis_follows_the_charge_and_not_the_time():
    model = replace(MODEL, hysteresis_v=0.02)
    half_c_ah = 0.5 * MODEL.capacity_ah
    assert Cell(model).go(3600.0, 0.0).states.hysteresis[0] == 0.0
    assert Cell(model).go(900.0, half_c_ah).states.hysteresis[0] == pytest.approx(-1.0, abs=0.01)
    turned = Cell(model).go(900.0, half_c_ah).go(900.0, -half_c_ah)
    assert turned.states.hysteresis[0] == pytest.approx(1.0, abs=0.02)
