"""The update: nearer to the truth, never surer than the evidence, hard to fool."""

import numpy as np
import pytest

from app.estimation.filters.reference.output import output_sigma, output_tangent
from app.estimation.filters.reference.state import SOC_MAX, SOC_MIN
from app.estimation.filters.reference.update import update
from app.estimation.filters.sigma_points import central_difference, unscented
from tests.unit.app.estimation.filters.reference.cells import sample, setup_of, state_at

RULES = {"ekf": None, "ukf": unscented, "cdkf": central_difference}
CELL = setup_of().cell


class Bench:
    """Cells that start at a SOC with a sigma and measure voltages at rest."""

    def __init__(self, soc, sigma=0.05, rule=central_difference):
        self.setup = setup_of(rule=rule)
        self.state = state_at(self.setup, soc, variance=sigma**2)

    def measure(self, volts, dt_s=1.0):
        state, motion, measured = sample(self.setup, self.state, volts=volts, dt_s=dt_s)
        if self.setup.rule is None:
            output = output_tangent(self.setup, state, motion, measured)
        else:
            output = output_sigma(self.setup, self.setup.rule, state, motion, measured)
        self.state, innovation = update(self.setup, state, motion, measured, output)
        return innovation


@pytest.mark.parametrize("name", RULES)
def test_a_voltage_draws_the_charge_towards_it_and_makes_it_surer(name):
    bench = Bench([0.5, 0.5], rule=RULES[name])
    before = bench.state.cov[0, 0]
    bench.measure(CELL.ocv(np.array([0.56, 0.44])))
    assert 0.5 < bench.state.soc[0] < 0.56
    assert 0.44 < bench.state.soc[1] < 0.5
    assert (bench.state.cov[0, 0] < before).all()


def test_a_missing_voltage_changes_nothing():
    bench = Bench([0.5, 0.5])
    before = bench.state
    innovation = bench.measure(np.array([np.nan, CELL.ocv(np.array([0.55]))[0]]))
    assert innovation.used.tolist() == [False, True]
    assert np.isnan(innovation.nu).tolist() == [True, False]
    assert bench.state.soc[0] == before.soc[0]
    np.testing.assert_array_equal(bench.state.cov[..., 0], before.cov[..., 0])


def test_an_outlier_is_refused_and_what_stays_is_believed_in_the_end():
    bench = Bench(0.5, sigma=0.01)
    far = CELL.ocv(np.array([0.9]))[0]
    assert not bench.measure(far).used.any()
    assert bench.state.soc[0] == 0.5
    for _ in range(300):
        bench.measure(far)
    assert bench.state.soc[0] == pytest.approx(0.9, abs=0.05)


def test_a_lone_outlier_leaves_no_trace():
    bench = Bench(0.5, sigma=0.01)
    near = CELL.ocv(np.array([0.5]))[0]
    bench.measure(near + 0.3)
    assert bench.state.refused_s[0] == 1.0
    bench.measure(near)
    assert bench.state.refused_s[0] == 0.0
    assert bench.state.soc[0] == pytest.approx(0.5, abs=1e-3)


def test_the_expected_innovation_grows_where_the_cell_is_nearly_empty():
    usual, empty = Bench(0.5, sigma=1e-4), Bench(0.02, sigma=1e-4)
    rest = usual.measure(CELL.ocv(np.array([0.5]))).sigma[0]
    assert empty.measure(CELL.ocv(np.array([0.02]))).sigma[0] > 1.5 * rest


@pytest.mark.parametrize("volts", [0.6, 5.9])
def test_the_charge_stays_within_its_bounds(volts):
    bench = Bench(0.5, sigma=0.4)
    for _ in range(50):
        bench.measure(volts, dt_s=60.0)
        assert SOC_MIN <= bench.state.soc[0] <= SOC_MAX
        assert np.linalg.eigvalsh(bench.state.cov[:, :, 0]).min() > 0.0
