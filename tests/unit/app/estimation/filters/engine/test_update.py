"""The update: nearer to the truth, never surer than the evidence, hard to fool."""

import numpy as np
import pytest

from app.estimation.filters.setup import Kind
from app.estimation.filters.sigma_points import central_difference, unscented
from tests.oracle.cells import NativeCells, setup_of
from tests.oracle.state import SOC_MAX, SOC_MIN

FILTERS = {
    "ekf": (Kind.TANGENT, None),
    "ukf": (Kind.SIGMA, unscented),
    "cdkf": (Kind.SIGMA, central_difference),
}
CELL = setup_of().cell


class Bench(NativeCells):
    """Cells that start at a SOC with a sigma and measure voltages at rest."""

    def __init__(self, soc, sigma=0.05, name="cdkf"):
        kind, rule = FILTERS[name]
        super().__init__(soc, sigma**2, kind=kind, rule=rule)


@pytest.mark.parametrize("name", FILTERS)
def test_a_voltage_draws_the_charge_towards_it_and_makes_it_surer(name):
    bench = Bench([0.5, 0.5], name=name)
    before = bench.state.cov[0, 0]
    bench.step(CELL.ocv(np.array([0.56, 0.44])))
    assert 0.5 < bench.state.soc[0] < 0.56
    assert 0.44 < bench.state.soc[1] < 0.5
    assert (bench.state.cov[0, 0] < before).all()


def test_a_missing_voltage_changes_nothing():
    bench = Bench([0.5, 0.5])
    unmeasured = Bench([0.5, 0.5])
    unmeasured.step(np.nan)
    innovation = bench.step(np.array([np.nan, CELL.ocv(np.array([0.55]))[0]]))
    assert innovation.accepted.tolist() == [False, True]
    assert np.isnan(innovation.innovation_v).tolist() == [True, False]
    assert bench.state.soc[0] == 0.5
    np.testing.assert_array_equal(bench.state.cov[..., 0], unmeasured.state.cov[..., 0])


def test_an_outlier_is_refused_and_what_stays_is_believed_in_the_end():
    bench = Bench(0.5, sigma=0.01)
    far = CELL.ocv(np.array([0.9]))[0]
    assert not bench.step(far).accepted.any()
    assert bench.state.soc[0] == 0.5
    for _ in range(300):
        bench.step(far)
    assert bench.state.soc[0] == pytest.approx(0.9, abs=0.05)


def test_a_lone_outlier_leaves_no_trace():
    bench = Bench(0.5, sigma=0.01)
    near = CELL.ocv(np.array([0.5]))[0]
    bench.step(near + 0.3)
    assert bench.state.refused_s[0] == 1.0
    bench.step(near)
    assert bench.state.refused_s[0] == 0.0
    assert bench.state.soc[0] == pytest.approx(0.5, abs=1e-3)


def test_the_expected_innovation_grows_where_the_cell_is_nearly_empty():
    usual, empty = Bench(0.5, sigma=1e-4), Bench(0.02, sigma=1e-4)
    rest = usual.step(CELL.ocv(np.array([0.5]))).innovation_sigma_v[0]
    assert empty.step(CELL.ocv(np.array([0.02]))).innovation_sigma_v[0] > 1.5 * rest


@pytest.mark.parametrize("volts", [0.6, 5.9])
def test_the_charge_stays_within_its_bounds(volts):
    bench = Bench(0.5, sigma=0.4)
    for _ in range(50):
        bench.step(volts, dt_s=60.0)
        assert SOC_MIN <= bench.state.soc[0] <= SOC_MAX
        assert np.linalg.eigvalsh(bench.state.cov[:, :, 0]).min() > 0.0
