"""A cell with a capacity and a resistance of its own is a cell of a model with those."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.filters.estimators import make_estimator

CELL = load_cell("samsung-25r-10p")
OWN_AH = np.array([0.8, 1.0, 1.1]) * CELL.capacity_ah
GROWN = np.array([1.0, 1.6, 0.8])
VOLTS = CELL.ocv.voltage(np.full(3, 0.8))
DEGC = np.full(3, 25.0)


def counted(estimator, steps=600):
    estimator.start(VOLTS, DEGC, 0.0, 0.8, 0.001)
    for k in range(steps):
        volts = np.full(3, np.nan)
        found = estimator.step(1.0, 40.0 if k % 3 else -20.0, volts, DEGC)
    return found.soc


@pytest.mark.parametrize("name", ["coulomb", "cdkf", "fused"])
def test_charge_is_counted_over_the_cells_own_capacity(name):
    mixed = make_estimator(name, CELL, 3, engine="numpy")
    mixed.use_capacity(OWN_AH)
    alone = [
        counted(make_estimator(name, replace(CELL, capacity_ah=float(own)), 3, engine="numpy"))[k]
        for k, own in enumerate(OWN_AH)
    ]
    np.testing.assert_allclose(counted(mixed), alone, atol=1e-6)


def test_both_engines_and_whole_records_count_alike():
    pytest.importorskip("numba", reason="numba is an optional extra")
    slow, fast = (make_estimator("fused", CELL, 3, engine=engine) for engine in ("numpy", "numba"))
    steps = 200
    current = np.where(np.arange(steps) % 2, 60.0, -10.0)
    volts = np.full((steps, 3), 3.8) + 0.01 * np.random.default_rng(1).normal(size=(steps, 3))
    for estimator in (slow, fast):
        estimator.start(volts[0], DEGC, 0.0)
        estimator.use_capacity(OWN_AH)
        estimator.use_resistance(GROWN)
    record = fast.run(np.full(steps, 0.1), current, volts, np.full((steps, 3), 25.0))
    stepped = [slow.step(0.1, float(i), v, DEGC).soc for i, v in zip(current, volts, strict=True)]
    np.testing.assert_allclose(record.soc, stepped, rtol=0, atol=1e-12)


def test_a_capacity_that_cannot_be_is_refused():
    estimator = make_estimator("fused", CELL, 3)
    with pytest.raises(ShapeError):
        estimator.use_capacity([25.0, 25.0])
    with pytest.raises(EstimatorError, match="capacity"):
        estimator.use_capacity([25.0, 0.0, 25.0])
    with pytest.raises(EstimatorError, match="capacity"):
        estimator.use_capacity(float("nan"))
    with pytest.raises(EstimatorError, match="factor"):
        estimator.use_resistance(-1.0)


def grown(factor):
    return replace(
        CELL,
        r0_ohm=factor * CELL.r0_ohm,
        r_ohm=factor * CELL.r_ohm,
        overpotential_v=None if CELL.overpotential_v is None else factor * CELL.overpotential_v,
    )


@pytest.mark.parametrize("name", ["coulomb", "ekf", "cdkf", "fused"])
def test_voltages_are_foretold_with_the_cells_own_resistance(name):
    def predicted(cell, taught):
        estimator = make_estimator(name, cell, 3, engine="numpy")
        estimator.use_resistance(taught)
        estimator.start(VOLTS, DEGC, 30.0, 0.8, 0.001)
        for k in range(100):
            found = estimator.step(1.0, 60.0 if k % 3 else -20.0, np.full(3, np.nan), DEGC)
        return found.voltage_v, found.soc

    mixed = predicted(CELL, GROWN)
    for k, factor in enumerate(GROWN):
        alone = predicted(grown(factor), 1.0)
        np.testing.assert_allclose(mixed[0][k], alone[0][k], atol=2e-3)
        np.testing.assert_allclose(mixed[1][k], alone[1][k], atol=2e-3)
    assert np.ptp(mixed[0]) > 0.005
