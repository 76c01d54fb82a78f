"""Whole records at once: the arrays that go in, the arrays that come out."""

from __future__ import annotations

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.filters.estimates import N_OUT, CellEstimator, Estimates


class Record(Estimates):
    """`Estimates` of every step: each array is (n_steps, n_cells), and `numbers` is (8, n_steps, n_cells)."""

    __slots__ = ()


def check_record(
    n_cells: int, dt_s: FloatArray, current_a: FloatArray, voltage_v: FloatArray, temperature_degc: FloatArray
) -> None:
    """Refuse arrays that do not fit each other.

    Raises:
        ShapeError: a shape is not (n_steps,) or (n_steps, n_cells).
        EstimatorError: a step is negative or not finite.
    """
    n = dt_s.size
    for name, array, shape in (
        ("dt_s", dt_s, (n,)),
        ("current_a", current_a, (n,)),
        ("voltage_v", voltage_v, (n, n_cells)),
        ("temperature_degc", temperature_degc, (n, n_cells)),
    ):
        if array.shape != shape:
            raise ShapeError(name, shape, array.shape)
    if not (np.isfinite(dt_s).all() and (dt_s >= 0.0).all()):
        raise EstimatorError("a step is negative or not finite")


def run_steps(
    estimator: CellEstimator,
    dt_s: FloatArray,
    current_a: FloatArray,
    voltage_v: FloatArray,
    temperature_degc: FloatArray,
) -> Record:
    """Return the estimates of a record by calling `step` for every sample."""
    steps, n = voltage_v.shape
    numbers = np.empty((N_OUT, steps, n))
    for k in range(steps):
        numbers[:, k] = estimator.step(float(dt_s[k]), float(current_a[k]), voltage_v[k], temperature_degc[k]).numbers
    return Record(numbers)
