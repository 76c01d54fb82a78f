"""The marginalised forms give the numbers of the textbook filters, whatever state, cell and sample they are given."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.inputs import InputGuard
from app.estimation.filters.marginal import MarginalFilter
from app.estimation.filters.process import Process
from app.estimation.filters.sigma_points import central_difference, unscented
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning
from tests.textbook_filters import additive_step, augmented_step
from tests.thesis_filter import marginal_augmented_step

RULES = {"ukf": unscented, "cdkf": central_difference}
OPEN_GATE = Tuning(gate=1e9, empty_factor=1.0)

unit = st.floats(-1.0, 1.0, allow_nan=False)
soc = st.floats(0.05, 0.95)
sigma = st.floats(0.005, 0.25)
step = st.sampled_from([0.01, 0.1, 1.0, 10.0, 3600.0])
voltage = st.floats(2.6, 4.2)
temperature = st.floats(-20.0, 70.0)


@cache
def packed(n_rc: int) -> PackedCell:
    base = load_cell()
    pairs = [k % 2 for k in range(n_rc)]
    over = np.full(base.r0_ohm.shape, 0.004)
    return PackedCell(
        replace(
            base, r_ohm=base.r_ohm[pairs], tau_s=base.tau_s[pairs], overpotential_v=over, overpotential_current_a=25.0
        )
    )


def output_of(cell: PackedCell, current_a: float, temperature_degc: float):
    """The terminal voltage of one cell, state by state, from the same tables."""
    row, weight = cell.place(np.array([temperature_degc]))

    def output(state):
        j, f = cell.place_soc(state[:1])
        c = cell.circuit_at(j, f, row, weight)[:, 0]
        over = np.arcsinh(current_a / cell.model.overpotential_current_a)
        return float(cell.ocv_at(j, f)[0] - current_a * c[0] - over * c[-1] - c[1:-1] @ state[1:])

    return output


def random_state(n_rc: int, soc_value: float, sd: float, seed: int):
    rng = np.random.default_rng(seed)
    d = 1 + n_rc
    mean = np.concatenate(([soc_value], rng.uniform(-50.0, 50.0, n_rc)))
    scale = np.concatenate(([sd], rng.uniform(1.0, 30.0, n_rc)))
    mix = rng.normal(size=(d, d)) + 2.0 * np.eye(d)
    correlation = mix @ mix.T
    root = np.sqrt(np.diag(correlation))
    return mean, scale[:, None] * (correlation / np.outer(root, root)) * scale


@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("n_rc", range(5))
@settings(max_examples=40, deadline=None)
@given(soc, sigma, unit, step, voltage, temperature, st.integers(0, 2**32 - 1))
def test_three_points_equal_the_full_set(name, n_rc, soc_value, sd, current_c, dt, volts, degc, seed):
    cell = packed(n_rc)
    rule = RULES[name](1 + n_rc)
    current = 250.0 * current_c
    mean, cov = random_state(n_rc, soc_value, sd, seed)
    states = CellStates(n_rc, 1)
    states.mean[:, 0], states.cov[:, :, 0] = mean, cov
    guard = InputGuard(cell, states, OPEN_GATE)
    sample = guard.check(dt, current, [volts], [degc])
    process = Process(cell, states, OPEN_GATE, counts=False)
    filt = MarginalFilter(cell, states, rule, OPEN_GATE)

    decay = np.concatenate(([1.0], np.exp(-dt / cell.tau_fixed_s)))
    gain = np.concatenate(([-process.moved_soc(current, dt)], (1.0 - decay[1:]) * current))
    process.predict(sample)
    process_noise = states.cov[:, :, 0] - decay[:, None] * cov * decay
    noise_v2 = sample.noise_v2 * float(sample.climate.noise_scale[0]) * sample.correlation
    wanted, wanted_cov = additive_step(
        mean,
        cov,
        rule,
        lambda state, _: decay * state + gain,
        process_noise,
        output_of(cell, current, degc),
        noise_v2,
        volts,
    )
    filt.update(sample, *np.empty((3, 1)))
    assert states.mean[SOC, 0] == pytest.approx(np.clip(wanted[SOC], -0.05, 1.05), abs=1e-12)
    np.testing.assert_allclose(states.mean[1:, 0], wanted[1:], rtol=0, atol=1e-9)
    assert states.cov[SOC, SOC, 0] == pytest.approx(wanted_cov[SOC, SOC], abs=1e-12)
    np.testing.assert_allclose(states.cov[:, :, 0], wanted_cov, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", RULES)
@settings(max_examples=60, deadline=None)
@given(soc, sigma, unit, st.floats(0.01, 20.0), step, voltage, st.integers(0, 2**32 - 1))
def test_five_points_equal_the_augmented_eleven(name, soc_value, sd, current_c, noise_a, dt, volts, seed):
    cell = packed(2)
    rule = RULES[name](5)
    current = 250.0 * current_c
    mean, cov = random_state(2, soc_value, sd, seed)
    decay = np.concatenate(([1.0], np.exp(-dt / cell.tau_fixed_s)))
    per_a = np.concatenate(([-dt / 90000.0], 1.0 - decay[1:]))
    wanted, wanted_cov = augmented_step(
        mean,
        cov,
        rule,
        lambda state, noise: decay * state + per_a * (current + noise),
        noise_a**2,
        output_of(cell, current, 25.0),
        0.04,
        volts,
    )

    def output(points):
        _, k, n = points.shape
        flat = points.reshape(3, k * n)
        row, weight = cell.place(np.full(k * n, 25.0))
        j, f = cell.place_soc(flat[SOC])
        c = cell.circuit_at(j, f, row, weight)
        over = np.arcsinh(current / cell.model.overpotential_current_a)
        h = cell.ocv_at(j, f) - current * c[0] - over * c[-1] - (c[1:-1] * flat[1:]).sum(axis=0)
        return h.reshape(k, n), -c[1:-1, :n]

    got, got_cov = marginal_augmented_step(
        mean[:, None], cov[:, :, None], rule, decay, per_a, current, noise_a, output, 0.04, np.array([volts])
    )
    assert got[SOC, 0] == pytest.approx(wanted[SOC], abs=1e-12)
    np.testing.assert_allclose(got_cov[SOC, :, 0], wanted_cov[SOC], rtol=1e-9, atol=1e-10)
