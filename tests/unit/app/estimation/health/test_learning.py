"""A filter that learns resistances along a recording."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.tuning import Tuning
from app.estimation.health.learned import LEARN_S, RESISTANCE_SIGMA_MAX, LearningRun
from app.estimation.health.resistance_scale import PRIOR_SIGMA, filter_factor
from tests.open_loop import simulate
from tests.oracle.both_engines import ENGINES, make_on
from tests.oracle.resistance import ReferenceResistance

TUNING = Tuning()
MODEL = load_cell("samsung-25r-10p")
GROWTH = 1.6
DT_S = 0.1


def samples(seconds, growths=(GROWTH,)):
    """A drive of cells that resist so many times their model, with one voltage missing."""
    time_s = np.arange(0.0, seconds, DT_S)
    current = np.where(time_s % 20.0 < 14.0, 130.0, -20.0)
    aged = [replace(MODEL, r0_ohm=each * MODEL.r0_ohm, r_ohm=each * MODEL.r_ohm) for each in growths]
    degc = np.full(time_s.size, 25.0)
    volts = np.stack([simulate(each, time_s, current, degc, 0.8)[1] for each in aged], axis=1)
    volts[40, 0] = np.nan
    steps = np.full(time_s.size, DT_S)
    return steps, steps, current, volts, volts, np.full(volts.shape, 25.0)


def learned(drive, pieces=1):
    _, _, current, volts, _, degc = drive
    estimator = make_estimator("fused", MODEL, volts.shape[1])
    estimator.start(volts[0], degc[0], current[0])
    run = LearningRun(estimator)
    parts = [np.array_split(each, pieces) for each in drive]
    return run, np.concatenate([run.step(part).soc for part in zip(*parts, strict=True)])


def learned_step_by_step(drive):
    """Return the oracle's factor and SOC: once a second the filter is given what was learned."""
    dt_s, lasted_s, current, volts, learned_v, degc = drive
    n = volts.shape[1]
    estimator = make_on(ENGINES["reference"], "fused", MODEL, n)
    estimator.start(volts[0], degc[0], current[0])
    regression = ReferenceResistance(np.ones(n), np.full(n, PRIOR_SIGMA**-2))
    factor, since_s, soc, flow_a = np.ones(n), 0.0, [], 0.0
    for k, lasted in enumerate(lasted_s):
        estimates = estimator.step(dt_s[k], current[k], volts[k], degc[k])
        soc.append(estimates.soc)
        flow_a += (1.0 - np.exp(-dt_s[k] / TUNING.wander_s)) * (abs(current[k]) - flow_a)
        if flow_a > TUNING.rest_c * MODEL.capacity_ah:
            regression.record(lasted_s[k : k + 1], estimates.numbers[None], factor, learned_v[k : k + 1])
        since_s += lasted
        if since_s >= LEARN_S:
            since_s, (found, sigma) = 0.0, regression.judge()
            factor = filter_factor(found, sigma <= RESISTANCE_SIGMA_MAX)
            estimator.use_resistance(factor)
    return factor, np.array(soc)


def test_a_filter_that_settles_at_rest_learns_no_resistance():
    steps, lasted_s, current, volts, _, degc = samples(60.0)
    resting_v = np.full_like(volts, MODEL.ocv.voltage([0.8])[0])
    resting_v[0] = MODEL.ocv.voltage([0.75])[0]
    run, _ = learned((steps, lasted_s, np.zeros_like(current), resting_v, resting_v, degc))
    assert run.judge()[0] == 1.0


def test_resistances_are_learned():
    run, _ = learned(samples(120.0))
    assert 1.3 < run.judge()[0] < GROWTH + 0.1, "most of the growth, and none that is not there"


@pytest.mark.parametrize("growths", [(GROWTH,), (0.9, 1.0, 1.1, 1.15), (1.3, 1.7, 1.5, 1.6, 1.6)])
def test_what_is_learned_along_a_drive_is_what_the_oracle_learns_step_by_step(growths):
    drive = samples(30.0, growths)
    run, soc = learned(drive)
    factor, expected = learned_step_by_step(drive)
    np.testing.assert_allclose(soc, expected, rtol=1e-9)
    np.testing.assert_allclose(run.factor, factor, rtol=1e-9)


def test_pieces_of_any_length_make_the_same_run():
    drive = samples(30.0)
    np.testing.assert_allclose(learned(drive, pieces=7)[1], learned(drive)[1], rtol=1e-12)


def test_cells_that_differ_are_predicted_with_what_they_differ_by():
    growths = np.array([0.87, 0.95, 1.0, 1.06, 1.12])
    run, _ = learned(samples(120.0, growths))
    np.testing.assert_allclose(run.factor, growths, atol=0.03)
