"""What a state predicts: the model's voltage, with the slopes and the curvature that a spread of SOC sees."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.filters.sigma_points import central_difference, unscented
from tests.oracle.cells import MODEL, SURFACE, sample, setup_of, state_at
from tests.oracle.output import output_sigma, output_tangent

OVER = replace(MODEL, overpotential_v=np.full(MODEL.r0_ohm.shape, 0.01), overpotential_current_a=25.0)
SOCS = np.array([0.15, 0.5, 0.85])
DEGC = np.array([12.0, 25.0, 48.0])
CURRENT_A = 70.0


def output(model, rule, sigma, correlated=0.0):
    """Return the state and the output of three cells."""
    setup = setup_of(model, rule=rule)
    state = state_at(setup, SOCS, variance=sigma**2, branch_v2=4.0)
    cov = state.cov.copy()
    cov[0, 1:-1] = cov[1:-1, 0] = correlated * sigma * 2.0
    state = replace(state, cov=cov, branch_a=np.array([[20.0, 30.0, 60.0], [5.0, 0.0, -10.0], [0.0, 0.0, 0.0]]))
    state, motion, measured = sample(setup, state, degc=DEGC, current_a=CURRENT_A)
    if rule is None:
        return state, output_tangent(setup, state, motion, measured)
    return state, output_sigma(setup, setup.rule, state, motion, measured)


@pytest.mark.parametrize("model", [MODEL, OVER, SURFACE])
@pytest.mark.parametrize("rule", [None, central_difference, unscented])
def test_a_sure_state_predicts_the_models_voltage_and_its_slopes(model, rule):
    state, found = output(model, rule, 1e-3)
    np.testing.assert_allclose(found.h, model.terminal_voltage(SOCS, state.branch_a[:-1], CURRENT_A, DEGC), atol=3e-4)
    step = 2e-3
    high, low = (model.terminal_voltage(SOCS + d, state.branch_a[:-1], CURRENT_A, DEGC) for d in (step, -step))
    np.testing.assert_allclose(found.H[0], (high - low) / (2 * step), rtol=0.05, atol=0.03)
    for k in range(model.n_rc):
        more, less = (state.branch_a[:-1] + d * (np.arange(model.n_rc) == k)[:, None] for d in (1.0, -1.0))
        high, low = (model.terminal_voltage(SOCS, branch, CURRENT_A, DEGC) for branch in (more, less))
        np.testing.assert_allclose(found.H[1 + k], (high - low) / 2.0, rtol=0.02, atol=1e-5)
    assert (found.bend_v2 >= 0.0).all()
    assert found.bend_v2.max() < 1e-7, "a third of a millivolt"


def test_a_spread_of_the_charge_sees_the_bend_of_the_curve():
    """Mean and slope come nearer to those of a sampled normal spread than the tangent does."""
    sigma = 0.06
    state, found = output(MODEL, central_difference, sigma)
    z = SOCS + sigma * np.random.default_rng(1).normal(size=(200_000, 3))
    branch = np.broadcast_to(state.branch_a[:-1, None], (MODEL.n_rc, *z.shape))
    rows = MODEL.terminal_voltage(z, branch, CURRENT_A, DEGC)
    _, tangent = output(MODEL, None, sigma)
    true_slope = ((z - SOCS) * (rows - rows.mean(axis=0))).mean(axis=0) / sigma**2
    assert np.abs(found.h - rows.mean(axis=0)).sum() < 0.7 * np.abs(tangent.h - rows.mean(axis=0)).sum()
    assert np.abs(found.H[0] - true_slope).sum() < 0.7 * np.abs(tangent.H[0] - true_slope).sum()
    assert found.bend_v2[0] > found.bend_v2[2], "the knee bends more than the plateau"


def test_what_the_rc_currents_share_with_the_charge_is_not_counted_twice():
    """P_xy = P H: the covariance of the output with SOC must not depend on how H splits correlated states."""
    _, shared = output(MODEL, central_difference, 0.02, correlated=0.6)
    _, plain = output(MODEL, central_difference, 0.02)
    np.testing.assert_allclose(shared.H, plain.H, rtol=0.05, atol=5e-3)
    assert (shared.H != plain.H).any()


def test_a_cell_of_twice_the_resistance_drops_twice_the_voltage():
    setup = setup_of()
    state, motion, measured = sample(setup, state_at(setup, SOCS, variance=1e-8), current_a=CURRENT_A)
    ocv = setup.cell.ocv(SOCS)
    drops = []
    for factor in (1.0, 2.0):
        grown = replace(state, resistance=np.full(3, factor))
        drops.append(ocv - output_sigma(setup, setup.rule, grown, motion, measured).h)
    np.testing.assert_allclose(drops[1], 2.0 * drops[0], rtol=1e-3)
