"""The whole least-squares problem on a cell that is known: its numbers come back, and bad rows do not bend them."""

import numpy as np
import pytest

from app.estimation.errors import ModelError
from app.estimation.identification.design import RESISTANCE_SOC, branch_current
from app.estimation.identification.parts import Part
from app.estimation.identification.problem import DEFAULT_ACTIVATION, Problem
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.recording.cell_recording import Recording

CAPACITY_AH = 3.0
GRID = np.linspace(0.0, 1.0, 101)
SLOW = SlowCurves(GRID, 3.0 + GRID, 3.04 + GRID, CAPACITY_AH, 0.1, True)
R0_OHM, R_OHM, TAU_S = 0.02, 0.012, 16.0
SEEN = slice(4, 12)  # knots between which the drive takes place


def drive(outliers=0):
    rng = np.random.default_rng(3)
    current = np.concatenate((np.zeros(10), np.repeat(rng.uniform(-4.0, 15.0, 150), 8)))
    time_s = 1.0 * np.arange(current.size)
    soc = 0.95 - np.concatenate(([0.0], np.cumsum(0.5 * (current[1:] + current[:-1])))) / 3600 / CAPACITY_AH
    volts = 3.02 + soc - R0_OHM * current - R_OHM * branch_current(time_s, current, TAU_S)
    volts += 3e-4 * rng.normal(size=volts.size)
    volts[rng.choice(volts.size, outliers, replace=False)] -= 0.3
    return Part(Recording("drive", time_s, current, volts, np.full(volts.size, 25.0), soc, ()), soc, True)


def problem(**how):
    return Problem([drive(**how)], SLOW, CAPACITY_AH, R0_OHM)


def total_ohm(solution):
    return solution.r0_ohm + solution.r_ohm.sum(axis=0)


def test_a_known_cell_comes_back_and_no_resistance_is_negative():
    found = problem().solve((TAU_S,), DEFAULT_ACTIVATION)
    assert (found.r0_ohm >= 0.0).all()
    assert (found.r_ohm >= 0.0).all()
    assert (found.overpotential_v >= 0.0).all()
    np.testing.assert_allclose(found.r0_ohm[SEEN], R0_OHM, rtol=0.1)
    np.testing.assert_allclose(total_ohm(found)[SEEN], R0_OHM + R_OHM, rtol=0.1)
    inside = np.linspace(0.4, 0.9, 6)
    np.testing.assert_allclose(found.ocv(SLOW, inside), 3.02 + inside, atol=0.003)


def test_the_right_time_constant_costs_least():
    this = problem()
    candidates = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
    chosen = this.choose_tau(candidates, 1, DEFAULT_ACTIVATION)
    assert chosen.tau_s == (16.0,)
    assert all(chosen.cost <= this.solve((tau,), DEFAULT_ACTIVATION).cost + 1e-6 for tau in candidates)
    two = this.choose_tau(candidates, 2, DEFAULT_ACTIVATION)
    assert two.cost <= chosen.cost + 1e-6, "a pair more cannot fit worse"


def test_none_to_choose_from_is_an_error_that_names_the_option():
    with pytest.raises(ModelError, match="--rc"):
        problem().choose_tau((5.0,), 2, DEFAULT_ACTIVATION)


def test_outliers_do_not_bend_a_robust_fit():
    bad = problem(outliers=60)
    plain = bad.solve((TAU_S,), DEFAULT_ACTIVATION)
    robust = bad.robust(plain)
    truth = R0_OHM + R_OHM
    error = {name: np.abs(total_ohm(s)[SEEN] - truth).max() for name, s in (("plain", plain), ("robust", robust))}
    assert error["robust"] < 0.5 * error["plain"]


def test_where_nothing_was_measured_the_priors_keep_it_near_the_neighbours():
    found = problem().solve((TAU_S,), DEFAULT_ACTIVATION)
    unseen = found.r0_ohm[: SEEN.start - 2]
    assert (unseen < 3.0 * R0_OHM).all()
    assert np.linalg.eigvalsh(problem().prior(2)).min() > 0.0
    assert found.r_ohm.shape == (1, RESISTANCE_SOC.size)


def test_activation_energies_far_from_the_usual_cost():
    this = problem()
    usual, odd = (this.solve((TAU_S,), energies) for energies in (DEFAULT_ACTIVATION, (80e3, 20e3, 20e3)))
    assert odd.cost > usual.cost, "at 25 degC nothing else tells them apart"


def test_a_fast_pair_never_takes_all_of_the_ohmic_resistance():
    fast = problem().solve((0.1,), DEFAULT_ACTIVATION)
    np.testing.assert_array_less(0.3 * R0_OHM - 1e-12, fast.r0_ohm)
