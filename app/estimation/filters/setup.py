"""What a filter is made of, the same for either engine, and what an engine does."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from app.estimation.arrays import FloatArray
from app.estimation.filters.estimates import N_OUT
from app.estimation.filters.sigma_points import SigmaRule
from app.estimation.filters.tables import CellTables
from app.estimation.filters.tuning import Tuning


class Kind(IntEnum):
    """How the state is estimated; the numbers are those of `vw_kind`."""

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
        """Whether the charge count has a part in what is reported."""
        return self.kind in (Kind.COUNT, Kind.SIGMA_FUSED)


class Engine(Protocol):
    """Computes one filter over n_cells cells and keeps its state.

    The state's quantities have the names of `vw_cells` in `vw_filter.h`: `branch_a` is (n_rc, n_cells), `cov`
    (1 + n_rc, 1 + n_rc, n_cells), all others (n_cells,).
    """

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        ...

    def start(
        self,
        current_a: float,
        voltage_v: FloatArray,
        temperature_degc: FloatArray,
        soc: FloatArray,
        soc_sigma: FloatArray,
    ) -> None:
        """Set the state from one sample and an initial SOC (n_cells,), each NaN where it is not known."""
        ...

    def step(self, dt_s: float, current_a: float, voltage_v: FloatArray, temperature_degc: FloatArray) -> FloatArray:
        """Return (8, n_cells) estimates after one sample, a new array; rows as in `Estimates`.

        Args:
            dt_s: since the sample before, finite and >= 0 [s].
            current_a: held over that time [A]; NaN or impossible: the last one counts.
            voltage_v: (n_cells,) [V]; NaN or impossible: not measured.
            temperature_degc: (n_cells,) [degC]; NaN or impossible: the last one counts.
        """
        ...

    def record(
        self,
        dt_s: FloatArray,
        current_a: FloatArray,
        voltage_v: FloatArray,
        temperature_degc: FloatArray,
        n_rows: int = N_OUT,
    ) -> FloatArray:
        """Return (n_rows, n_steps, n_cells) estimates of samples in a row: (n_steps,) and (n_steps, n_cells) each."""
        ...

    def get(self, name: str) -> FloatArray:
        """Return a copy of one quantity of the state."""
        ...

    def set(self, name: str, values: FloatArray) -> None:
        """Replace one quantity of the state."""
        ...
