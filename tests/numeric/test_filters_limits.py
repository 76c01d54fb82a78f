"""Cases whose answer is known: linear cells, rest, constant current, gaps, outliers, wrong starts."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.filters.estimators import Tuning, make_estimator
from tests.open_loop import simulate

FILTERED = ["ekf", "ukf", "cdkf"]
EVERY = [*FILTERED, "fused"]


def linear_cell() -> CellModel:
    return CellModel(
        name="linear",
        capacity_ah=2.0,
        ocv=OcvCurve([0.0, 1.0], [3.0, 4.0]),
        soc_grid=[0.5],
        temperature_grid_degc=[25.0],
        r0_ohm=[[0.02]],
        r_ohm=[[[0.01]], [[0.015]]],
        tau_s=[[[5.0]], [[80.0]]],
    )


def drive(seconds: float, dt_s: float = 0.1, seed: int = 0, c_rate: float = 3.0):
    """Time and current (in C) of three seconds of rest, then bursts and coasting."""
    rng = np.random.default_rng(seed)
    n = int(seconds / dt_s)
    burst = np.repeat(rng.choice([0.0, 0.2, 1.0, 0.7, -0.3], n // 15 + 1), 15)[:n]
    burst[: int(3.0 / dt_s)] = 0.0
    return np.arange(n) * dt_s, burst * c_rate


@pytest.mark.parametrize("name", FILTERED)
def test_on_a_linear_cell_every_filter_is_the_kalman_filter(name):
    model, tuning = linear_cell(), Tuning(empty_factor=1.0, gate=1e9, lasting_v=0.0, lasting_rel=0.0)
    estimator = make_estimator(name, model, 1, tuning)
    estimator.start([3.6], [25.0], 0.0, soc=0.4, soc_sigma=0.2)
    x, cov = estimator.state_mean[:, 0], estimator.state_cov[0]
    time, current_c = drive(200.0)
    rng = np.random.default_rng(3)
    soc, volts = simulate(model, time, 2.0 * current_c, np.full(time.shape, 25.0), 0.7)
    h = np.array([1.0, -0.01, -0.015])
    for k in range(1, time.size):
        dt, i = time[k] - time[k - 1], 2.0 * current_c[k]
        measured = volts[k] + rng.normal() * 2e-3
        a = np.exp(-dt / np.array([5.0, 80.0]))
        walk = tuning.soc_walk**2 * dt + 1e-12
        branch = (tuning.branch_rel * i) ** 2
        keep = np.diag([np.sqrt(1.0 - walk / 0.25), *a])
        x = np.array([1.0, *a]) * x + np.array([-i * dt / 7200.0, *((1.0 - a) * i)])
        cov = keep @ cov @ keep + np.diag([walk, *((1.0 - a**2) * branch + 4e-12)])
        noise_v2 = tuning.voltage_variance(i * model.drop_per_c_v / 2.0) * tuning.correlation_factor(dt)
        expected_v2 = h @ cov @ h + noise_v2
        gain = cov @ h / expected_v2
        x = x + gain * (measured - (3.0 + h @ x - 0.02 * i))
        cov = cov - np.outer(gain, gain) * expected_v2
        estimator.step(dt, i, [measured], [25.0])
    np.testing.assert_allclose(estimator.state_mean[:, 0], x, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(estimator.state_cov[0], cov, rtol=1e-5, atol=1e-9)
    assert x[0] == pytest.approx(soc[-1], abs=0.01)


@pytest.mark.parametrize("name", EVERY)
def test_at_rest_the_soc_settles_on_the_curve_and_sigma_keeps_the_model_error(name):
    model = load_cell()
    volts = model.ocv.voltage([0.2, 0.5, 0.8])
    estimator = make_estimator(name, model, 3)
    estimator.start(volts, np.full(3, 25.0), 0.0, soc=0.35)
    for _ in range(1800):
        estimates = estimator.step(1.0, 0.0, volts, np.full(3, 25.0))
    np.testing.assert_allclose(estimates.soc, [0.2, 0.5, 0.8], atol=0.01)
    assert (estimates.soc_sigma > 0.003).all()
    assert (estimates.soc_sigma < 0.03).all()


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("dt_s", [0.02, 0.1, 1.0])
def test_a_start_wrong_by_half_is_put_right_at_any_sampling_rate(name, dt_s):
    model = load_cell()
    time, current_c = drive(120.0, dt_s)
    temperature = np.full(time.shape, 25.0)
    soc, volts = simulate(model, time, 25.0 * current_c, temperature, 0.85)
    estimator = make_estimator(name, model, 1)
    estimator.start(volts[:1], [25.0], 25.0 * current_c[0], soc=0.35)
    dt = np.diff(time, prepend=time[0])
    record = estimator.run(dt, 25.0 * current_c, volts[:, None], temperature[:, None])
    error = np.abs(record.soc[:, 0] - soc)
    assert error[time > 20.0].max() < 0.05
    assert error[time > 60.0].max() < 0.02


@pytest.mark.parametrize("name", EVERY)
def test_a_confident_wrong_start_in_the_middle_of_a_drive_does_not_lock_in(name):
    model = load_cell()
    time, current_c = drive(1500.0, seed=4)
    temperature = np.full(time.shape, 30.0)
    soc, volts = simulate(model, time, 25.0 * current_c, temperature, 0.95)
    begin = 3000
    estimator = make_estimator(name, model, 1)
    estimator.start(volts[begin : begin + 1], [30.0], 25.0 * current_c[begin], soc=soc[begin] - 0.4, soc_sigma=0.01)
    dt = np.diff(time, prepend=time[0])[begin:]
    record = estimator.run(dt, 25.0 * current_c[begin:], volts[begin:, None], temperature[begin:, None])
    assert np.abs(record.soc[-1, 0] - soc[-1]) < 0.03


@pytest.mark.parametrize("name", EVERY)
def test_single_outliers_move_nothing(name):
    model = load_cell()
    volts = float(model.ocv.voltage(0.6))
    estimator = make_estimator(name, model, 1)
    estimator.start([volts], [25.0], 0.0, soc=0.6)
    for _ in range(600):
        before = estimator.step(0.1, 0.0, [volts], [25.0])
    for spike in (2.5, 4.2, 5.9, 3.0):
        estimates = estimator.step(0.1, 0.0, [spike], [25.0])
        assert not estimates.accepted[0]
        assert abs(estimates.soc[0] - before.soc[0]) < 1e-4
        estimates = estimator.step(0.1, 0.0, [volts], [25.0])
        assert estimates.accepted[0]


@pytest.mark.parametrize("name", EVERY)
def test_a_cell_without_voltage_is_counted_and_its_neighbours_do_not_notice(name):
    model = load_cell()
    rest = model.ocv.voltage([0.7, 0.7])
    full, half = (make_estimator(name, model, 2) for _ in range(2))
    for estimator in (full, half):
        estimator.start(rest, np.full(2, 25.0), 0.0, soc=0.7)
    for _ in range(3000):
        a = full.step(0.1, 25.0, rest - 0.06, np.full(2, 25.0))
        b = half.step(0.1, 25.0, [np.nan, rest[1] - 0.06], np.full(2, 25.0))
    assert b.soc[0] == pytest.approx(0.7 - 300.0 / 3600.0, abs=0.01)
    assert b.soc_sigma[0] > 0.0
    assert np.isnan(b.innovation_v[0])
    assert b.soc[1] == a.soc[1]


@pytest.mark.parametrize("name", EVERY)
def test_a_gap_of_hours_is_one_exact_step(name):
    model = load_cell()
    estimator = make_estimator(name, model, 1)
    estimator.start([float(model.ocv.voltage(0.8))], [25.0], 0.0, soc=0.8)
    estimates = estimator.step(4 * 3600.0, 2.5, [np.nan], [25.0])
    assert estimates.soc[0] == pytest.approx(0.4, abs=8e-3)
    np.testing.assert_allclose(estimator.state_mean[1:, 0], 2.5)


def test_a_model_that_does_not_fit_the_cell_is_called_invalid():
    model = load_cell()
    wrong = replace(model, ocv=OcvCurve(model.ocv.soc, model.ocv.voltage_v), r0_ohm=model.r0_ohm * 4.0)
    time, current_c = drive(600.0, seed=2)
    temperature = np.full(time.shape, 25.0)
    _, good = simulate(model, time, 25.0 * current_c, temperature, 0.9)
    _, bad = simulate(wrong, time, 25.0 * current_c, temperature, 0.9)
    estimator = make_estimator("fused", model, 2)
    estimator.start([good[0], bad[0]], [25.0, 25.0], 0.0, soc=0.9)
    record = estimator.run(
        np.diff(time, prepend=0.0), 25.0 * current_c, np.stack((good, bad), axis=1), np.full((time.size, 2), 25.0)
    )
    assert record.model_valid[:, 0].all()
    assert not record.model_valid[-1, 1]
