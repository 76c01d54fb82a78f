"""A record that numpy estimates by the block is the record of so many single steps."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.filters import BLOCK_STEPS
from app.estimation.filters.record import run_steps
from app.estimation.filters.tuning import Tuning

N = 4
STEPS = 3 * BLOCK_STEPS + 5


def clean():
    rng = np.random.default_rng(3)
    volts = 3.8 + np.cumsum(rng.normal(0.0, 1e-3, (STEPS, N)), axis=0)
    degc = np.repeat(np.round(rng.uniform(5.0, 40.0, (STEPS // 40 + 1, N))), 40, axis=0)[:STEPS]
    return np.full(STEPS, 0.1), rng.uniform(-30.0, 90.0, STEPS), volts, degc


def hostile():
    rng = np.random.default_rng(4)
    dt, current, volts, degc = clean()
    dt[rng.random(STEPS) < 0.1] = 2.0
    dt[7] = 0.0
    current[rng.random(STEPS) < 0.05] = np.nan
    volts[rng.random((STEPS, N)) < 0.05] = np.nan
    volts[rng.random((STEPS, N)) < 0.05] = 2.9
    degc[rng.random((STEPS, N)) < 0.02] = np.nan
    return dt, current, volts, degc


@pytest.mark.parametrize("record", [clean, hostile])
@pytest.mark.parametrize(("name", "soc", "capacity_ah"), [
    ("fused", 0.6, None),
    ("fused", 0.05, None),  # contradicted until the count is anchored anew
    ("fused", 0.6, 21.0),
    ("cdkf", 0.6, None),
    ("ekf", 0.6, 27.0),
])  # fmt: skip
def test_a_block_gives_what_its_steps_give(record, name, soc, capacity_ah):
    samples = record()
    answers = []
    for run in (lambda estimator: estimator.run(*samples), lambda estimator: run_steps(estimator, *samples)):
        estimator = make_estimator(name, load_cell(), N, Tuning(anchor_s=5.0), engine="numpy")
        estimator.start(samples[2][0], samples[3][0], 0.0, soc=soc)
        if capacity_ah is not None:
            estimator.use_capacity(capacity_ah)
        numbers = run(estimator).numbers
        answers.append((numbers, estimator.state_mean, estimator.state_cov, estimator.counted_soc))
    for block, steps in zip(*answers, strict=True):
        np.testing.assert_allclose(block, steps, rtol=0, atol=1e-12)


def test_a_start_that_was_wrong_is_anchored_within_a_block():
    samples = clean()
    estimator = make_estimator("fused", load_cell(), N, Tuning(anchor_s=5.0), engine="numpy")
    estimator.start(samples[2][0], samples[3][0], 0.0, soc=0.05)
    estimator.run(*samples)
    assert np.abs(estimator.counted_soc - estimator.state_mean[0]).max() < 0.1
