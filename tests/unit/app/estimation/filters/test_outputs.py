"""What a state predicts: the model's voltage, with the slopes and the curvature that a spread of SOC sees."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.inputs import InputGuard
from app.estimation.filters.outputs import SigmaOutput, TangentOutput
from app.estimation.filters.sigma_points import central_difference, unscented
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning

BASE = load_cell("samsung-25r-10p")
OVER = replace(BASE, overpotential_v=np.full(BASE.r0_ohm.shape, 0.01), overpotential_current_a=25.0)
SOCS = np.array([0.15, 0.5, 0.85])
DEGC = np.array([12.0, 25.0, 48.0])
CURRENT_A = 70.0


def output(model, kind, sigma, correlated=0.0):
    """Return the mean output, the slopes and the curvature for three cells."""
    cell, states = PackedCell(model), CellStates(model.n_rc, 3)
    states.mean[SOC] = SOCS
    states.mean[1:] = np.array([[20.0, 30.0, 60.0], [5.0, 0.0, -10.0]])
    states.cov[:] = 0.0
    states.cov[SOC, SOC] = sigma**2
    for k in range(1, 1 + model.n_rc):
        states.cov[k, k] = 4.0
        states.cov[SOC, k] = states.cov[k, SOC] = correlated * sigma * 2.0
    step = InputGuard(cell, states, Tuning()).check(0.1, CURRENT_A, np.full(3, 3.7), DEGC)
    found = TangentOutput(cell, states) if kind is None else SigmaOutput(cell, states, kind(1 + model.n_rc))
    mean, curvature = np.empty((2, 3))
    found.at(step, mean, curvature)
    return states, mean, found.slopes.copy(), curvature


@pytest.mark.parametrize("model", [BASE, OVER])
@pytest.mark.parametrize("kind", [None, central_difference, unscented])
def test_a_sure_state_predicts_the_models_voltage_and_its_slopes(model, kind):
    states, mean, slopes, curvature = output(model, kind, 1e-3)
    branch = states.mean[1:]
    np.testing.assert_allclose(mean, model.terminal_voltage(SOCS, branch, CURRENT_A, DEGC), atol=3e-4)
    step = 2e-3
    high, low = (model.terminal_voltage(SOCS + d, branch, CURRENT_A, DEGC) for d in (step, -step))
    np.testing.assert_allclose(slopes[SOC], (high - low) / (2 * step), rtol=0.05, atol=0.03)
    np.testing.assert_allclose(slopes[1:], -model.parameters(SOCS, DEGC)[2 : 2 + model.n_rc], rtol=2e-3)
    assert (curvature >= 0.0).all()
    assert curvature.max() < 1e-7, "a third of a millivolt"


def test_a_spread_of_the_charge_sees_the_bend_of_the_curve():
    """Mean and slope come nearer to those of a sampled normal spread than the tangent does."""
    sigma = 0.06
    states, mean, slopes, curvature = output(BASE, central_difference, sigma)
    z = SOCS + sigma * np.random.default_rng(1).normal(size=(200_000, 3))
    branch = np.broadcast_to(states.mean[1:, None], (BASE.n_rc, *z.shape))
    rows = BASE.terminal_voltage(z, branch, CURRENT_A, DEGC)
    tangent = output(BASE, None, sigma)
    true_slope = ((z - SOCS) * (rows - rows.mean(axis=0))).mean(axis=0) / sigma**2
    assert np.abs(mean - rows.mean(axis=0)).sum() < 0.7 * np.abs(tangent[1] - rows.mean(axis=0)).sum()
    assert np.abs(slopes[SOC] - true_slope).sum() < 0.7 * np.abs(tangent[2][SOC] - true_slope).sum()
    assert curvature[0] > curvature[2], "the knee bends more than the plateau"


def test_what_the_rc_currents_share_with_the_charge_is_not_counted_twice():
    """P_xy = P H: the covariance of the output with SOC must not depend on how H splits correlated states."""
    states, _, slopes, _ = output(BASE, central_difference, 0.02, correlated=0.6)
    _, _, plain, _ = output(BASE, central_difference, 0.02)
    np.testing.assert_allclose(slopes, plain, rtol=0.05, atol=5e-3)
    assert states.cov[SOC, 1, 0] > 0.0
