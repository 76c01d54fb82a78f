"""The first minutes estimated again with the resistances that driving has shown."""

from dataclasses import replace

import numpy as np
import pytest

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
