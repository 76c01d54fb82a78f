"""The setup of a filter: cell model, kind and tuning."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from app.estimation.filters.sigma_points import SigmaRule
from app.estimation.filters.tables import CellTables
from app.estimation.filters.tuning import Tuning


class Kind(IntEnum):
    """The kind of a filter; the numbers are those of `vw_kind`."""

    COUNT = 0  # charge count alone
    TANGENT = 1  # extended Kalman filter
    SIGMA = 2  # sigma-point filter
    SIGMA_FUSED = 3  # sigma-point filter fused with the charge count


@dataclass(frozen=True)
class FilterSetup:
    """One filter over any number of cells of a model.

    Attributes:
        cell: tables of the cell model.
        kind: how the state is estimated.
        rule: of the sigma points; None where there are none.
        tuning: assumptions of the filter.
    """

    cell: CellTables
    kind: Kind
    rule: SigmaRule | None
    tuning: Tuning

    @property
    def counts(self) -> bool:
        """Return whether the charge count has a part in what is reported."""
        return self.kind in (Kind.COUNT, Kind.SIGMA_FUSED)
