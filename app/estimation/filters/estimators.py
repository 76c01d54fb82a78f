"""The one door to the filters: choose one by name, feed it all cells at once, read what it believes.

Inputs are plain arrays and a step length; nothing here knows a clock, a link or a car.
"""

from __future__ import annotations

from typing import Final

from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.estimation.filters.coulomb import CoulombCounter
from app.estimation.filters.estimates import CellEstimator, Estimates
from app.estimation.filters.filters import Engine, GaussianEstimator
from app.estimation.filters.sigma_points import central_difference, unscented
from app.estimation.filters.tuning import Tuning

__all__ = ["FILTERS", "CellEstimator", "Engine", "Estimates", "Tuning", "make_estimator"]

FILTERS: Final = ("fused", "coulomb", "ekf", "ukf", "cdkf")


def make_estimator(
    filter_name: str, cell: CellModel, n_cells: int, tuning: Tuning | None = None, engine: Engine = "auto"
) -> CoulombCounter | GaussianEstimator:
    """Return a filter over `n_cells` cells of one model that share a current; `start` it before the first step.

    Args:
        filter_name: one of FILTERS. "fused" is the default of the product: a CDKF fused with a charge count.
        cell: the cell model, module parameters for a module of parallel cells.
        n_cells: how many cells one call of `step` covers.
        tuning: assumptions of the filter; None = the one tuning for all cells.
        engine: "numba" compiles when the filter is made, "auto" does where numba is installed. Same numbers.

    Raises:
        EstimatorError: the name is none of FILTERS, n_cells is not positive, or numba was asked for and is missing.
    """
    if n_cells < 1:
        raise EstimatorError(f"{n_cells} cells cannot be filtered")
    tuning = tuning or Tuning()
    n_dim = 1 + cell.n_rc
    if filter_name == "coulomb":
        return CoulombCounter(cell, n_cells, tuning)
    if filter_name == "fused":
        return GaussianEstimator(cell, n_cells, central_difference(n_dim), tuning, fused=True, engine=engine)
    if filter_name == "ekf":
        return GaussianEstimator(cell, n_cells, None, tuning, engine=engine)
    if filter_name == "ukf":
        return GaussianEstimator(cell, n_cells, unscented(n_dim), tuning, engine=engine)
    if filter_name == "cdkf":
        return GaussianEstimator(cell, n_cells, central_difference(n_dim), tuning, engine=engine)
    raise EstimatorError(f"{filter_name!r} is none of the filters: {', '.join(FILTERS)}")
