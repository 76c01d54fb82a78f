"""Every module as it is now, out of a season: what packs are built from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.errors import ConfigError
from app.estimation.arrays import FloatArray
from app.season.cells.history import CellHistory, newest_median

NEWEST = 5  # sessions


@dataclass(frozen=True)
class Modules:
    """(n_cells,): capacity and its sigma [Ah], resistance over the median one and [ohm], how much warmer it ran [K]."""

    capacity_ah: FloatArray
    capacity_sigma_ah: FloatArray
    resistance: FloatArray
    resistance_ohm: FloatArray
    warmer_k: FloatArray
    has_capacity: bool  # else all are as the cell file says, 5 % off


def modules_of(histories: Sequence[CellHistory]) -> dict[str, Modules]:
    """Return what the newest sessions of each car say, by the car; one whose cells were never driven is left out.

    Raises:
        ConfigError: nothing was measured of any.
    """
    found = {history.car: modules for history in histories if (modules := _modules(history)) is not None}
    if not found:
        sessions = sum(len(history.sessions) for history in histories)
        raise ConfigError("season", sessions, "a finished session in which the cells were driven")
    return found


def _modules(history: CellHistory) -> Modules | None:
    """The newest sessions of a car; what is not known of a module is the median's."""
    resistance = history.today(history.resistance)
    if not np.isfinite(resistance).any():
        return None
    capacity, sigma = np.full(history.n_cells, np.nan), np.full(history.n_cells, np.nan)
    known = np.isfinite(history.today(history.capacity_ah))
    for cell in np.flatnonzero(known.any(axis=0)):
        rows = np.flatnonzero(known[:, cell])[-NEWEST:]
        weights = 1.0 / history.capacity_sigma_ah[rows, cell] ** 2
        capacity[cell] = float(weights @ history.capacity_ah[rows, cell] / weights.sum())
        sigma[cell] = float(weights.sum() ** -0.5)
    relative = _filled(newest_median(resistance, NEWEST))
    relative = relative / np.median(relative)
    warm = newest_median(history.temperature_degc, NEWEST)
    return Modules(
        np.full(history.n_cells, history.nominal_ah) if not known.any() else _filled(capacity),
        np.full(history.n_cells, 0.05 * history.nominal_ah) if not known.any() else _filled(sigma),
        relative,
        relative * history.resistance_ohm,
        np.zeros(history.n_cells) if not np.isfinite(warm).any() else _filled(warm) - np.nanmean(warm),
        bool(known.any()),
    )


def _filled(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nanmedian(values))
