"""A filter that learns resistances along a recording, with either engine."""

from dataclasses import replace

import numpy as np

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.reference.engine import ReferenceEngine
from app.estimation.health.learning import LearningRun
from tests.open_loop import simulate

MODEL = load_cell("samsung-25r-10p")
GROWTH = 1.6
DT_S = 0.1


def samples(seconds):
    """A drive of a cell that resists GROWTH times its model, with one voltage missing."""
    time_s = np.arange(0.0, seconds, DT_S)
    current = np.where(time_s % 20.0 < 14.0, 130.0, -20.0)
    aged = replace(MODEL, r0_ohm=GROWTH * MODEL.r0_ohm, r_ohm=GROWTH * MODEL.r_ohm)
    _, volts = simulate(aged, time_s, current, np.full(time_s.size, 25.0), 0.8)
    volts[40] = np.nan
    steps, volts = np.full(time_s.size, DT_S), volts[:, None]
    return steps, steps, current, volts, volts, np.full(volts.shape, 25.0)


def learned(drive, pieces=1, **words):
    _, _, current, volts, _, degc = drive
    estimator = make_estimator("fused", MODEL, 1, **words)
    estimator.start(volts[0], degc[0], current[0])
    run = LearningRun(estimator)
    parts = [np.array_split(each, pieces) for each in drive]
    return run, np.concatenate([run.step(part).soc for part in zip(*parts, strict=True)])


def test_resistances_are_learned():
    run, _ = learned(samples(120.0))
    assert 1.3 < run.judge()[0] < GROWTH + 0.1, "most of the growth, and none that is not there"


def test_the_engine_learns_along_a_drive_what_the_reference_does():
    drive = samples(30.0)
    native, soc = learned(drive)
    reference, expected = learned(drive, engine=ReferenceEngine)
    np.testing.assert_allclose(soc, expected, rtol=1e-9)
    np.testing.assert_allclose(native.factor, reference.factor, rtol=1e-9)


def test_pieces_of_any_length_make_the_same_run():
    drive = samples(30.0)
    np.testing.assert_allclose(learned(drive, pieces=7)[1], learned(drive)[1], rtol=1e-12)
