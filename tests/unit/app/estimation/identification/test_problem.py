"""The whole least-squares problem on a cell that is known: its numbers come back, and bad rows do not bend them."""

import numpy as np
import pytest

from app.estimation.errors import ModelError
from app.estimation.identification.design import (
    DEFAULT_ACTIVATION_J_MOL,
    OFFSET_SOC,
    RESISTANCE_SOC,
    arrhenius,
    branch_current,
)
from app.estimation.identification.parts import Part
from app.estimation.identification.problem import Problem
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.recording.cell_recording import Recording

CAPACITY_AH = 3.0
GRID = np.linspace(0.0, 1.0, 101)
SLOW = SlowCurves(GRID, 3.0 + GRID, 3.04 + GRID, CAPACITY_AH, 0.1, True)
R0_OHM, R_OHM, TAU_S = 0.02, 0.012, 16.0
SEEN = slice(4, 12)  # knots between which the drive takes place
KNOTS_DEGC = np.array([25.0])


def drive(outliers=0, degc=25.0, factor=1.0, shift_v=0.0):
    rng = np.random.default_rng(3)
    current = np.concatenate((np.zeros(10), np.repeat(rng.uniform(-4.0, 15.0, 150), 8)))
    time_s = 1.0 * np.arange(current.size)
    soc = 0.95 - np.concatenate(([0.0], np.cumsum(0.5 * (current[1:] + current[:-1])))) / 3600 / CAPACITY_AH
    volts = 3.02 + shift_v + soc
    volts -= factor * (R0_OHM * current + R_OHM * branch_current(time_s, current, TAU_S))
    volts += 3e-4 * rng.normal(size=volts.size)
    volts[rng.choice(volts.size, outliers, replace=False)] -= 0.3
    return Part(Recording("drive", time_s, current, volts, np.full(volts.size, degc), soc, ()), soc, True)


def problem(**how):
    return Problem([drive(**how)], SLOW, CAPACITY_AH, R0_OHM, KNOTS_DEGC, 25.0)


def total_ohm(solution):
    return (solution.r0_ohm + solution.r_ohm.sum(axis=0))[0]


def test_a_known_cell_comes_back_and_no_resistance_is_negative():
    found = problem().solve((TAU_S,))
    assert (found.r0_ohm >= 0.0).all()
    assert (found.r_ohm >= 0.0).all()
    assert (found.overpotential_v >= 0.0).all()
    np.testing.assert_allclose(found.r0_ohm[0, SEEN], R0_OHM, rtol=0.1)
    np.testing.assert_allclose(total_ohm(found)[SEEN], R0_OHM + R_OHM, rtol=0.1)
    inside = np.linspace(0.4, 0.9, 6)
    ocv_v = found.blended_v(SLOW, inside) + np.interp(inside, OFFSET_SOC, found.offset_v[0])
    np.testing.assert_allclose(ocv_v, 3.02 + inside, atol=0.003)


def test_the_right_time_constant_costs_least():
    this = problem()
    candidates = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
    chosen = this.choose_tau(candidates, 1)
    assert chosen.tau_s == (16.0,)
    assert all(chosen.cost <= this.solve((tau,)).cost + 1e-6 for tau in candidates)
    two = this.choose_tau(candidates, 2)
    assert two.cost <= chosen.cost + 1e-6, "a pair more cannot fit worse"


def test_none_to_choose_from_is_an_error_that_names_the_option():
    with pytest.raises(ModelError, match="--rc"):
        problem().choose_tau((5.0,), 2)


def test_outliers_do_not_bend_a_robust_fit():
    bad = problem(outliers=60)
    plain = bad.solve((TAU_S,))
    robust = bad.robust(plain)
    truth = R0_OHM + R_OHM
    error = {name: np.abs(total_ohm(s)[SEEN] - truth).max() for name, s in (("plain", plain), ("robust", robust))}
    assert error["robust"] < 0.5 * error["plain"]


def test_where_nothing_was_measured_the_priors_keep_it_near_the_neighbours():
    found = problem().solve((TAU_S,))
    unseen = found.r0_ohm[0, : SEEN.start - 2]
    assert (unseen < 3.0 * R0_OHM).all()
    assert np.linalg.eigvalsh(problem().prior(2)).min() > 0.0
    assert found.r_ohm.shape == (1, 1, RESISTANCE_SOC.size)


def test_tests_at_two_temperatures_give_each_its_own_resistance_and_open_circuit_voltage():
    """The cold cell resists 1.5 times what the usual activation energy says, and rests 20 mV lower."""
    knots = np.array([0.0, 25.0])
    cold = 1.5 * float(arrhenius(np.array([0.0]), DEFAULT_ACTIVATION_J_MOL)[0])
    parts = [drive(degc=0.0, factor=cold, shift_v=-0.02), drive()]
    found = Problem(parts, SLOW, CAPACITY_AH, R0_OHM, knots, 25.0).solve((TAU_S,))
    total = found.r0_ohm + found.r_ohm.sum(axis=0)
    np.testing.assert_allclose(total[:, SEEN].mean(axis=1), np.array([1.5, 1.0]) * (R0_OHM + R_OHM), rtol=0.05)
    inside = slice(4, 10)
    np.testing.assert_allclose((found.offset_v[0] - found.offset_v[1])[inside], -0.02, atol=0.005)


def test_a_temperature_without_a_test_follows_its_neighbour():
    found = Problem([drive()], SLOW, CAPACITY_AH, R0_OHM, np.array([0.0, 25.0]), 25.0).solve((TAU_S,))
    np.testing.assert_allclose(found.r0_ohm[0], found.r0_ohm[1], rtol=1e-3)
    np.testing.assert_allclose(found.offset_v[0], 0.0, atol=1e-6)


def test_a_fast_pair_never_takes_all_of_the_ohmic_resistance():
    fast = problem().solve((0.1,))
    np.testing.assert_array_less(0.3 * R0_OHM - 1e-12, fast.r0_ohm)
