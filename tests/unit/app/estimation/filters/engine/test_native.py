"""The C engine takes the steps of the reference, for every filter and shape of model, and its state is readable."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.engine import native
from app.estimation.filters.engine.native import NativeEngine
from app.estimation.filters.estimators import FILTERS, filter_setup, make_estimator
from tests.oracle.both_engines import ENGINES, make_on, step_both
from tests.oracle.engine import ReferenceEngine
from tests.oracle.state import State

N = 13  # not a whole number of blocks
BASE = load_cell()
MODELS = {
    "two pairs": BASE,
    "hysteresis": replace(BASE, hysteresis_v=0.02),
    "asinh": replace(BASE, overpotential_v=np.full(BASE.r0_ohm.shape, 0.01), overpotential_current_a=25.0),
    "tau over soc": replace(BASE, tau_s=BASE.tau_s * np.linspace(0.8, 1.2, BASE.soc_grid.size)),
    "one temperature": replace(
        BASE,
        temperature_grid_degc=[25.0],
        r0_ohm=BASE.r0_ohm[3:4],
        r_ohm=BASE.r_ohm[:, 3:4],
        tau_s=BASE.tau_s[:, 3:4],
        overpotential_v=None,
    ),
    "no pair": replace(BASE, r_ohm=BASE.r_ohm[:0], tau_s=BASE.tau_s[:0]),
    "four pairs": replace(BASE, r_ohm=BASE.r_ohm[[0, 1, 0, 1]], tau_s=BASE.tau_s[[0, 1, 0, 1]]),
}


def samples(seed: int, n_steps: int):
    """A drive with missing samples, outliers, gaps and temperatures outside the tables."""
    rng = np.random.default_rng(seed)
    degc = rng.uniform(-15.0, 65.0, N)
    for k in range(n_steps):
        volts = 3.75 - 0.0001 * k + rng.normal(0.0, 0.02, N)
        if k % 7 == 0:
            volts[k % N] = np.nan
        if k % 11 == 0:
            volts[:3] = 2.0
        if 20 < k < 60:
            volts[5] = 4.2
        if k % 40 == 0:
            degc = np.where(rng.random(N) < 0.2, np.nan, rng.uniform(-15.0, 65.0, N))
        yield float(rng.choice([0.0, 0.1, 0.1, 1.0, 30.0])), float(rng.normal() * 80.0), volts, degc


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", FILTERS)
def test_the_engine_equals_the_reference(name, model):
    native, reference = (make_on(engine, name, MODELS[model], N) for engine in ENGINES.values())
    for estimator in (native, reference):
        estimator.start(np.full(N, 3.8), np.full(N, 20.0), 0.0, soc=np.linspace(0.2, 0.9, N))
        estimator.use_capacity(np.linspace(0.8, 1.1, N) * BASE.capacity_ah)
        estimator.use_resistance(np.linspace(0.9, 1.4, N))
    for sample in samples(4, 64):
        step_both(native, reference, sample)


@pytest.mark.parametrize("quantity", State.__dataclass_fields__)
def test_what_is_set_is_what_is_read(quantity):
    setup = filter_setup("fused", BASE)
    native, reference = NativeEngine(setup, N), ReferenceEngine(setup, N)
    values = np.random.default_rng(3).random(reference.get(quantity).shape)
    if quantity == "cov":
        values = values + np.swapaxes(values, 0, 1)
    for engine in (native, reference):
        engine.set(quantity, values)
        np.testing.assert_array_equal(engine.get(quantity), values)
        engine.get(quantity)[...] = 0.0
        np.testing.assert_array_equal(engine.get(quantity), values)


def test_cells_know_nothing_of_their_neighbours():
    together = make_estimator("fused", BASE, N)
    alone = [make_estimator("fused", BASE, 1) for _ in range(N)]
    volts = np.linspace(3.6, 3.9, N)
    together.start(volts, np.full(N, 25.0), 0.0)
    for one, v in zip(alone, volts, strict=True):
        one.start([v], [25.0], 0.0)
    for _ in range(50):
        found = together.step(0.1, 30.0, volts, np.full(N, 25.0)).numbers
        single = [one.step(0.1, 30.0, [v], [25.0]).numbers for one, v in zip(alone, volts, strict=True)]
    np.testing.assert_array_equal(found, np.concatenate(single, axis=1))


def test_estimates_of_one_step_are_not_changed_by_the_next():
    estimator = make_estimator("fused", BASE, 2)
    estimator.start([3.7, 3.8], [25.0, 25.0], 0.0)
    first = estimator.step(0.1, 30.0, [3.7, 3.8], [25.0, 25.0])
    kept = first.numbers.copy()
    estimator.step(10.0, 90.0, [3.5, 3.6], [25.0, 25.0])
    np.testing.assert_array_equal(first.numbers, kept)


def test_an_answer_stays_what_it_was_however_many_follow():
    estimator = make_estimator("fused", load_cell(), 40)
    volts, degc = np.linspace(3.4, 4.0, 40), np.full(40, 25.0)
    estimator.start(volts, degc, 0.0, soc=0.5)
    kept = [estimator.step(0.1, 20.0, volts, degc) for _ in range(2 * native.ANSWERS + 3)]
    copies = [each.numbers.copy() for each in kept]
    for _ in range(2 * native.ANSWERS):
        estimator.step(0.1, -20.0, volts, degc).numbers[:] = np.nan
    for each, copy in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(each.numbers, copy)


@pytest.mark.parametrize("n_cells", [1, 31, 32, 33, 96])
def test_a_step_and_a_record_of_changing_temperatures_are_the_reference(n_cells):
    """Numbers that are kept between two looks into the tables do not outlive the temperature they were read at."""
    rng = np.random.default_rng(n_cells)
    estimators = [make_on(engine, "fused", load_cell(), n_cells) for engine in ENGINES.values()]
    for each in estimators:
        each.start(np.full(n_cells, 3.7), np.full(n_cells, 25.0), 0.0)
    for step in range(60):
        degc = np.where(rng.random(n_cells) < 0.2, 25.0 + rng.integers(-20, 20, n_cells), 25.0)
        sample = (5.0, 60.0 * np.sin(step / 5), 3.7 + rng.normal(0.0, 0.02, n_cells), degc)
        ours, theirs = (each.step(*sample).numbers for each in estimators)
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
