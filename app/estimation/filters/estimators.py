"""The one door to the filters: choose one by name, feed it all cells at once, read what it believes.

Inputs are plain arrays and a step length; nothing here knows a clock, a link or a car.
"""

from __future__ import annotations

from typing import Final

from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.estimation.filters.engine.native import NativeEngine
from app.estimation.filters.estimates import Estimates
from app.estimation.filters.filter_names import FILTERS
from app.estimation.filters.setup import FilterSetup, Kind
from app.estimation.filters.sigma_points import central_difference, unscented
from app.estimation.filters.soc_estimator import SocEstimator
from app.estimation.filters.tables import CellTables
from app.estimation.filters.tuning import Tuning

__all__ = ["FILTERS", "Estimates", "SocEstimator", "Tuning", "filter_setup", "make_estimator"]

_KINDS: Final = {
    "fused": (Kind.SIGMA_FUSED, central_difference),
    "coulomb": (Kind.COUNT, None),
    "ekf": (Kind.TANGENT, None),
    "ukf": (Kind.SIGMA, unscented),
    "cdkf": (Kind.SIGMA, central_difference),
}


def make_estimator(
    filter_name: str,
    cell: CellModel,
    n_cells: int,
    tuning: Tuning | None = None,
) -> SocEstimator:
    """Return a filter over `n_cells` cells of one model that share a current; `start` it before the first step.

    Args:
        filter_name: one of FILTERS. "fused" is the default of the product: a CDKF fused with a charge count.
        cell: the cell model, module parameters for a module of parallel cells.
        n_cells: how many cells one call of `step` covers.
        tuning: assumptions of the filter; None = the one tuning for all cells.

    Raises:
        EstimatorError: the name is none of FILTERS, n_cells is not positive, or the engine's library is missing.
    """
    if n_cells < 1:
        raise EstimatorError(f"{n_cells} cells cannot be filtered")
    setup = filter_setup(filter_name, cell, tuning)
    return SocEstimator(setup, NativeEngine(setup, n_cells))


def filter_setup(filter_name: str, cell: CellModel, tuning: Tuning | None = None) -> FilterSetup:
    """Return what the filter of a name is made of; see `make_estimator`.

    Raises:
        EstimatorError: the name is none of FILTERS.
    """
    if filter_name not in _KINDS:
        raise EstimatorError(f"{filter_name!r} is none of the filters: {', '.join(FILTERS)}")
    kind, rule = _KINDS[filter_name]
    return FilterSetup(CellTables(cell), kind, rule(2 + cell.n_rc) if rule else None, tuning or Tuning())
