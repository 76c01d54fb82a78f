"""Between two samples: charge moves, RC currents follow, ignorance grows and never leaves its bounds."""

from dataclasses import replace

import numpy as np
import pytest

from tests.open_loop import simulate
from tests.oracle.cells import MODEL, NativeCells
from tests.oracle.state import SOC_VARIANCE_MAX

MOVING = replace(MODEL, tau_s=MODEL.tau_s * np.linspace(0.8, 1.2, MODEL.soc_grid.size))


class Cell(NativeCells):
    """One cell that is only predicted: its voltage is not measured."""

    def __init__(self, model=MODEL, soc=0.6):
        super().__init__(soc, branch_v2=4.0, model=model)

    def go(self, dt_s, current_a):
        self.step(np.nan, dt_s, current_a)
        return self.state


def test_charge_and_rc_currents_move_as_the_circuit_says():
    current = np.repeat([60.0, 0.0, -30.0, 120.0], 50)
    time_s = np.cumsum(np.random.default_rng(2).uniform(0.05, 3.0, current.size))
    soc, _ = simulate(MODEL, time_s, current, np.full(current.size, 25.0), 0.6)
    cell = Cell()
    branch = np.zeros(MODEL.n_rc)
    for dt, i in zip(np.diff(time_s, prepend=time_s[0]), current, strict=True):
        state = cell.go(float(dt), float(i))
        decay = np.exp(-dt / MODEL.tau_s[:, 0, 0])
        branch = decay * branch + (1.0 - decay) * i
    assert state.soc[0] == pytest.approx(soc[-1], abs=1e-12)
    assert state.count_soc[0] == pytest.approx(soc[-1], abs=1e-12)
    np.testing.assert_allclose(state.branch_a[:-1, 0], branch, atol=1e-9)
    assert state.branch_a[-1, 0] == 0.0, "no current drives the lasting error"


@pytest.mark.parametrize("model", [MODEL, MOVING])
def test_one_long_step_is_many_short_ones(model):
    """Of held current; to first order only where time constants depend on the SOC that moves meanwhile."""
    long, short = Cell(model).go(20.0, 40.0), Cell(model)
    for _ in range(200):
        end = short.go(0.1, 40.0)
    np.testing.assert_allclose(long.soc, end.soc, rtol=1e-9)
    np.testing.assert_allclose(long.branch_a, end.branch_a, rtol=1e-3)
    np.testing.assert_allclose(long.cov, end.cov, rtol=0.01, atol=1e-7)


def test_ignorance_grows_to_its_bound_and_stays_definite():
    cell = Cell()
    before = cell.state.cov[0, 0, 0]
    assert cell.go(60.0, 0.0).cov[0, 0, 0] > before
    for _ in range(300):
        state = cell.go(86_400.0, 50.0)
    assert state.cov[0, 0, 0] <= SOC_VARIANCE_MAX * (1 + 1e-9)
    assert (np.linalg.eigvalsh(state.cov[:, :, 0]) > 0.0).all()


def test_hysteresis_follows_the_charge_and_not_the_time():
    model = replace(MODEL, hysteresis_v=0.02)
    half_c_a = 0.5 * MODEL.capacity_ah
    assert Cell(model).go(3600.0, 0.0).hysteresis[0] == 0.0
    turned = Cell(model)
    assert turned.go(900.0, half_c_a).hysteresis[0] == pytest.approx(-1.0, abs=0.01)
    assert turned.go(900.0, -half_c_a).hysteresis[0] == pytest.approx(1.0, abs=0.02)


def test_the_count_grows_uncertain_with_charge_and_with_time():
    moved, waited = Cell(soc=0.5), Cell(soc=0.5)
    after, rested = moved.go(3600.0, 0.4 * MODEL.capacity_ah), waited.go(3600.0, 0.0)
    tuning = moved.setup.tuning
    offset_v2 = tuning.counter_offset_c**2
    assert after.count_soc[0] == pytest.approx(0.1)
    assert after.count_v2[0] == pytest.approx(1e-4 + (0.4 * tuning.counter_gain) ** 2 + offset_v2)
    assert rested.count_v2[0] == pytest.approx(1e-4 + offset_v2)
