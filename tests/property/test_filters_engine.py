"""The C engine takes every step that the reference takes, to 1e-9, however hostile cell, state and samples are."""

from dataclasses import replace

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from app.estimation.cell_model.cell_file import bundled_cells, load_cell
from app.estimation.filters.engine.native_resistance import NativeResistance
from app.estimation.filters.estimators import FILTERS
from tests.campaign import campaign, of_size
from tests.oracle.both_engines import ENGINES, hostile_steps, make_on, step_both
from tests.oracle.cells import SURFACE
from tests.oracle.resistance import ReferenceResistance

N_CELLS = 50
EXAMPLES = of_size(6, 60, 120, 200)
STEPS = 100  # steps of 50 cells each: a million cell-steps in the full campaign

CELLS = [*map(load_cell, bundled_cells()), SURFACE]
cells = st.sampled_from(CELLS)
hysteresis = st.sampled_from([0.0, 0.02])
overpotential = st.sampled_from([None, 0.01])


@given(st.integers(0, 2**32 - 1))
def test_the_engine_learns_the_resistances_of_the_reference(seed):
    rng = np.random.default_rng(seed)
    prior, prior_weight = rng.uniform(0.3, 3.0, N_CELLS), rng.uniform(10.0, 1e3, N_CELLS)
    native, reference = (make(prior, prior_weight) for make in (NativeResistance, ReferenceResistance))
    for n_steps in (1, 30, 2):
        dt_s = rng.choice([0.0, 1e-3, 0.1, 1.0, 3.0, 1e5], n_steps)
        said = rng.uniform(3.0, 4.0, (n_steps, 8, N_CELLS)) * rng.choice([1.0, 1.001, np.nan, 2.0], (n_steps, 1, 1))
        volts = said[:, 3] + rng.choice([0.0, 1e-3, 0.1, 2.0, np.nan], (n_steps, N_CELLS)) * rng.normal()
        factor = rng.uniform(0.3, 3.0, N_CELLS)
        for regression in (native, reference):
            regression.record(dt_s, said, factor, volts)
        np.testing.assert_allclose(native.judge(), reference.judge(), rtol=1e-9, atol=1e-9)


@campaign(60, 120, 400)
@settings(max_examples=EXAMPLES)
@given(st.sampled_from(FILTERS), cells, hysteresis, overpotential, st.integers(0, 2**32 - 1))
@example("fused", load_cell("lco-pouch"), 0.0, None, 281)  # a reading at rest whose weight is too small for a number
def test_the_engine_takes_the_steps_of_the_reference(name, cell, hysteresis_v, over_v, seed):
    over = cell.overpotential_v if over_v is None else np.full(cell.r0_ohm.shape, over_v)
    model = replace(cell, hysteresis_v=hysteresis_v, overpotential_v=over)
    rng = np.random.default_rng(seed)
    native, reference = (make_on(engine, name, model, N_CELLS) for engine in ENGINES.values())
    volts = np.where(rng.random(N_CELLS) < 0.1, np.nan, rng.uniform(2.5, 4.3, N_CELLS))
    soc = np.where(rng.random(N_CELLS) < 0.3, np.nan, rng.random(N_CELLS))
    sigma = np.where(rng.random(N_CELLS) < 0.3, np.nan, rng.random(N_CELLS))
    capacity_ah, resistance = rng.uniform(0.5, 1.2, N_CELLS) * model.capacity_ah, rng.uniform(0.5, 3.0, N_CELLS)
    current_a = float(rng.normal())
    for estimator in (native, reference):
        estimator.use_capacity(capacity_ah)
        estimator.use_resistance(resistance)
        estimator.start(volts, np.full(N_CELLS, 20.0), current_a, soc, sigma)
    for sample in hostile_steps(seed, STEPS, N_CELLS):
        step_both(native, reference, sample)
