"""The marginalised forms give the numbers of the textbook filters, whatever state, cell and sample they are given."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.setup import FilterSetup, Kind
from app.estimation.filters.sigma_points import central_difference, unscented
from app.estimation.filters.tables import COLD, DROP_ERROR, LASTING_DROP, OCV, OVERPOTENTIAL, R0, R1, CellTables
from app.estimation.filters.tuning import Tuning
from tests.campaign import examples
from tests.oracle.both_engines import ENGINES
from tests.oracle.state import motion_of
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
def packed(n_rc: int, has_surface: bool = False) -> CellTables:
    base = load_cell()
    pairs = [k % 2 for k in range(n_rc)]
    over = np.full(base.r0_ohm.shape, 0.004)
    cell = replace(
        base, r_ohm=base.r_ohm[pairs], tau_s=base.tau_s[pairs], overpotential_v=over, overpotential_current_a=25.0
    )
    if has_surface:
        # one exchange current: at the points an overpotential over SOC follows its expansion, not the function itself
        d = np.linspace(1e-3, 2e-4, base.temperature_grid_degc.size) * (1.0 + np.arange(n_rc))[:, None]
        cell = replace(cell, surface_per_a=d, reference_a=np.full(base.r0_ohm.shape, 25.0))
    return CellTables(cell)


def output_of(cell: CellTables, current_a: float, temperature_degc: float):
    """The terminal voltage of one cell, state by state, from the same tables."""
    at = cell.place_temperature(np.array([temperature_degc]))

    def output(state):
        c = cell.circuit(state[:1], at)[:, 0]
        over = np.arcsinh(current_a / cell.model.overpotential_current_a)
        return float(c[OCV] - current_a * c[R0] - over * c[OVERPOTENTIAL] - c[R1:] @ state[1:])

    return output


def random_state(n_rc: int, soc_value: float, sd: float, seed: int):
    rng = np.random.default_rng(seed)
    d = 2 + n_rc
    mean = np.concatenate(([soc_value], rng.uniform(-50.0, 50.0, n_rc), rng.uniform(-0.05, 0.05, 1)))
    scale = np.concatenate(([sd], rng.uniform(1.0, 30.0, n_rc), rng.uniform(0.005, 0.1, 1)))
    mix = rng.normal(size=(d, d)) + 2.0 * np.eye(d)
    correlation = mix @ mix.T
    root = np.sqrt(np.diag(correlation))
    return mean, scale[:, None] * (correlation / np.outer(root, root)) * scale


@pytest.mark.parametrize("engine", ENGINES.values(), ids=ENGINES)
@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("has_surface", [False, True])
@pytest.mark.parametrize("n_rc", range(5))
@settings(max_examples=examples(25))
@given(soc, sigma, unit, step, voltage, temperature, st.integers(0, 2**32 - 1))
def test_three_points_equal_the_full_set(
    engine, name, n_rc, has_surface, soc_value, sd, current_c, dt, volts, degc, seed
):
    cell = packed(n_rc, has_surface)
    setup = FilterSetup(cell, Kind.SIGMA, RULES[name](1 + cell.n_rc), OPEN_GATE)
    current = 250.0 * current_c
    mean, cov = random_state(n_rc, soc_value, sd, seed)

    def after(measured_v):
        filt = engine(setup, 1)
        filt.set("soc", mean[:1])
        filt.set("branch_a", mean[1:, None])
        filt.set("cov", cov[:, :, None])
        filt.step(dt, current, np.array([measured_v]), np.array([degc]))
        return np.concatenate((filt.get("soc"), filt.get("branch_a")[:, 0])), filt.get("cov")[:, :, 0]

    motion = motion_of(setup, dt, current)
    _, predicted_cov = after(np.nan)
    decay = np.concatenate(([1.0], np.exp(-dt / cell.tau_s)))
    gain = np.concatenate(([-motion.moved_ah / cell.model.capacity_ah], (1.0 - decay[1:]) * current))
    gain[-1] = 0.0  # nothing drives the lasting error
    uncertainty = cell.uncertainty_at(np.array([degc]))[:, 0]
    drop_v = uncertainty[LASTING_DROP] * current
    error_v2 = OPEN_GATE.voltage_variance(drop_v) + (uncertainty[DROP_ERROR] * drop_v) ** 2
    predicted_soc = mean[0] + gain[0]
    empty = min(OPEN_GATE.empty_soc * uncertainty[COLD], 1.0)
    growth = 1.0 + max(empty - predicted_soc, 0.0) / empty * (OPEN_GATE.empty_factor * uncertainty[COLD] - 1.0)
    noise_v2 = error_v2 * growth**2 * motion.correlation
    # the textbook's points lie along the SOC at the surface, where that is not the SOC
    to_surface = np.eye(mean.size)
    to_surface[0, 1:] = -cell.surface_at(cell.place_temperature(np.array([degc])))[:, 0]
    wanted, wanted_cov = additive_step(
        to_surface @ (decay * mean + gain),
        to_surface @ predicted_cov @ to_surface.T,
        setup.rule,
        lambda state, _: state,
        np.zeros_like(cov),
        output_of(cell, current, degc),
        noise_v2,
        volts,
    )
    back = np.linalg.inv(to_surface)
    wanted, wanted_cov = back @ wanted, back @ wanted_cov @ back.T
    found, found_cov = after(volts)
    assert found[0] == pytest.approx(np.clip(wanted[0], -0.05, 1.05), abs=1e-10)  # rounding, seen: 1.4e-12
    np.testing.assert_allclose(found[1:], wanted[1:], rtol=0, atol=1e-9)
    assert found_cov[0, 0] == pytest.approx(wanted_cov[0, 0], abs=1e-10)
    np.testing.assert_allclose(found_cov, wanted_cov, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", RULES)
@settings(max_examples=examples(60))
@given(soc, sigma, unit, st.floats(0.01, 20.0), step, voltage, st.integers(0, 2**32 - 1))
def test_five_points_equal_the_augmented_set(name, soc_value, sd, current_c, noise_a, dt, volts, seed):
    cell = packed(2)
    rule = RULES[name](6)
    current = 250.0 * current_c
    mean, cov = random_state(2, soc_value, sd, seed)
    decay = np.concatenate(([1.0], np.exp(-dt / cell.tau_s)))
    per_a = np.concatenate(([-dt / 90000.0], 1.0 - decay[1:]))
    per_a[-1] = 0.0  # nothing drives the lasting error
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
        flat = points.reshape(4, k * n)
        c = cell.circuit(flat[0], cell.place_temperature(np.full(k * n, 25.0)))
        over = np.arcsinh(current / cell.model.overpotential_current_a)
        h = c[OCV] - current * c[R0] - over * c[OVERPOTENTIAL] - (c[R1:] * flat[1:]).sum(axis=0)
        return h.reshape(k, n), -c[R1:, :n]

    got, got_cov = marginal_augmented_step(
        mean[:, None], cov[:, :, None], rule, decay, per_a, current, noise_a, output, 0.04, np.array([volts])
    )
    assert got[0, 0] == pytest.approx(wanted[0], abs=1e-10)
    np.testing.assert_allclose(got_cov[0, :, 0], wanted_cov[0], rtol=1e-9, atol=1e-10)
