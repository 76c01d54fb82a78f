"""The C engine and its oracle in numpy, for what has to hold whichever computes; samples that no battery sends."""

from collections.abc import Iterator

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.filters.engine.native import NativeEngine
from app.estimation.filters.estimators import filter_setup
from app.estimation.filters.soc_estimator import SocEstimator
from tests.oracle.engine import ReferenceEngine
from tests.oracle.state import State

TOLERANCE = 1e-9
ENGINES = {"c": NativeEngine, "reference": ReferenceEngine}


def make_on(engine: type, name: str, cell: CellModel, n_cells: int) -> SocEstimator:
    """Return a filter as `make_estimator` does, computed by one of ENGINES."""
    setup = filter_setup(name, cell)
    return SocEstimator(setup, engine(setup, n_cells))


def hostile_steps(seed: int, n_steps: int, n_cells: int) -> Iterator[tuple[float, float, FloatArray, FloatArray]]:
    """Currents that jump, voltages from nowhere, values missing, steps from none to hours."""
    rng = np.random.default_rng(seed)
    for k in range(n_steps):
        dt = float(rng.choice([0.0, 1e-3, 0.1, 1.0, 60.0, 3600.0, 1e5]))
        current = float(rng.choice([0.0, rng.normal() * 100.0, rng.normal() * 1e3, 1e9, np.nan]))
        volts = rng.choice([rng.uniform(2.0, 4.5), 0.0, 5.9, 6.5535, np.nan, -1.0], size=n_cells)
        volts = np.where(rng.random(n_cells) < 0.6, rng.uniform(2.4, 4.3, n_cells), volts)
        degc = rng.choice([25.0, -40.0, 120.0, np.nan, 1e6], size=n_cells)
        if k % 97 == 0:
            volts[:] = np.nan
        yield dt, current, volts, degc


def step_both(
    native: SocEstimator, reference: SocEstimator, sample: tuple[float, float, FloatArray, FloatArray]
) -> None:
    """Step both from the state of the first and compare all that they answer and all that they keep, to 1e-9.

    From the same state: small differences grow over steps, whichever engine computes, as those of a measurement do.
    """
    for quantity in State.__dataclass_fields__:
        reference.engine.set(quantity, native.engine.get(quantity))
    _compare("estimates", native.step(*sample).numbers, reference.step(*sample).numbers)
    for quantity in State.__dataclass_fields__:
        _compare(quantity, native.engine.get(quantity), reference.engine.get(quantity))


def _compare(name: str, found: FloatArray, expected: FloatArray) -> None:
    is_close = np.abs(found - expected) <= TOLERANCE * (1.0 + np.abs(expected))
    if not (is_close | (np.isnan(found) & np.isnan(expected))).all():
        np.testing.assert_allclose(found, expected, rtol=TOLERANCE, atol=TOLERANCE, err_msg=name)
