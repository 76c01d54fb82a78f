"""The first minutes estimated again with the resistances that driving has shown."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.first_minutes import KEPT_S, LEARNED_S, FirstMinutes
from tests.open_loop import simulate

MODEL = load_cell("samsung-25r-10p")
GROWTH = 1.6
DEGC = np.full(1, 25.0)
KNOWN = np.array([True])


def driven(seconds=100.0, dt_s=0.1):
    """Return SOC, voltages and currents of an aged cell that is already driven hard when the first sample comes."""
    n, lead = int(seconds / dt_s), 600
    phase = np.arange(lead + n) * dt_s
    current = np.where(phase % 20.0 < 14.0, 130.0, -20.0)
    aged = replace(MODEL, r0_ohm=GROWTH * MODEL.r0_ohm, r_ohm=GROWTH * MODEL.r_ohm)
    soc, volts = simulate(aged, phase, current, np.full(lead + n, 25.0), 0.8)
    return soc[lead:], volts[lead:, None], current[lead:]


def restarted(factor, volts, current):
    estimator = make_estimator("fused", MODEL, 1)
    estimator.use_resistance(factor)
    estimator.start(volts[0], DEGC, current[0])
    return estimator


def test_a_start_under_load_is_righter_once_the_resistances_are_known():
    soc, volts, current = driven()
    estimator, first = restarted(1.0, volts, current), FirstMinutes()
    for k, (v, i) in enumerate(zip(volts, current, strict=True)):
        first.keep(0.1 * (k > 0), i, v, DEGC)
        found = estimator.step(0.1 * (k > 0), i, v, DEGC)
    again = first.again(np.array([GROWTH]), KNOWN, lambda: restarted(GROWTH, volts, current))
    assert again is not None
    assert abs(again[1].soc[0] - soc[-1]) < 0.5 * abs(found.soc[0] - soc[-1])
    assert again[0].state_mean[0, 0] == pytest.approx(soc[-1], abs=0.03)
    assert first.again(np.array([GROWTH]), KNOWN, lambda: estimator) is None, "once"


@pytest.mark.parametrize(("factor", "is_learned"), [(1.01, True), (1.6, False)])
def test_nothing_is_estimated_again_for_little_or_for_nothing_learned(factor, is_learned):
    _, volts, current = driven(1.0)
    first = FirstMinutes()
    first.keep(LEARNED_S, current[0], volts[0], DEGC)
    assert first.again(np.array([factor]), np.array([is_learned]), lambda: pytest.fail("not asked for")) is None


@pytest.mark.parametrize("what", ["late", "gap"])
def test_samples_are_not_kept_for_long_nor_over_a_gap(what):
    _, volts, current = driven(1.0)
    first = FirstMinutes()
    first.keep(0.0, current[0], volts[0], DEGC)
    if what == "gap":
        first.drop()
    first.keep(LEARNED_S if what == "gap" else KEPT_S + 1.0, current[0], volts[0], DEGC)
    assert first.again(np.array([1.6]), KNOWN, lambda: pytest.fail("nothing is kept")) is None


class Listener:
    """An estimator that only notes what it is told."""

    def __init__(self):
        self.received = []

    def step(self, dt_s, current_a, voltages_v, temperatures_degc):
        self.received.append((dt_s, current_a, voltages_v.tolist(), temperatures_degc.tolist()))
        return len(self.received)


@given(st.lists(st.floats(-200.0, 200.0), min_size=1, max_size=50), st.sampled_from([1, 14, 216]))
def test_every_sample_is_estimated_again_in_its_order_as_it_was_then(currents_a, n_cells):
    first, volts, degc, fresh = FirstMinutes(), np.empty(n_cells), np.full(n_cells, 25.0), Listener()
    dt_s = (LEARNED_S + 1.0) / len(currents_a)
    for k, current_a in enumerate(currents_a):
        volts[:] = 3.0 + k / 100.0  # the caller's array is its own, and used again
        first.keep(dt_s, current_a, volts, degc)
    estimator, last = first.again(np.full(n_cells, 1.6), np.full(n_cells, True), lambda: fresh)
    assert estimator is fresh
    assert last == len(currents_a)
    assert [each[1] for each in fresh.received] == currents_a
    assert [each[2][0] for each in fresh.received] == [3.0 + k / 100.0 for k in range(len(currents_a))]


@pytest.mark.parametrize(("learned", "is_worth_it"), [(96, True), (90, True), (80, False), (0, False)])
def test_one_cell_that_is_not_measured_holds_up_no_other_and_many_do(learned, is_worth_it):
    first, fresh = FirstMinutes(), Listener()
    first.keep(LEARNED_S, 50.0, np.full(96, 3.7), np.full(96, 25.0))
    again = first.again(np.full(96, 1.2), np.arange(96) < learned, lambda: fresh)
    assert (again is not None) == is_worth_it


def test_an_estimator_that_began_with_these_resistances_is_not_begun_again():
    first = FirstMinutes(np.full(96, 1.2))
    first.keep(LEARNED_S, 50.0, np.full(96, 3.7), np.full(96, 25.0))
    again = first.again(np.full(96, 1.21), np.full(96, True), lambda: pytest.fail("nothing has changed"))
    assert again is None


def test_nothing_is_estimated_again_without_a_sample():
    assert FirstMinutes().again(np.full(1, 1.6), KNOWN, lambda: pytest.fail("nothing was kept")) is None
