"""The measurements of every cell, one row a session: what trends, ageing, ranking and comparison are computed from.

They come from the cell passports (capacity between rests, self-discharge, swaps of modules) and from sessions that were
estimated again (resistance at the temperature and SOC of the moment, charge passed). Facts of the season lake may take
their place: whoever makes a `CellHistory` is asked nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from app.analysis.passport.history import SessionRecord, Swap, lost_between, passports, rested_soc
from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.capacity import SOC_MOVED_MIN

DAY_S: Final = 86400.0
REST_SOC_SIGMA: Final = 0.002  # of the difference of two rests; how much pauses differ beyond it, the line finds
RELATIVE_SIGMA: Final = 0.01  # of a resistance against the median cell, where nobody said


@dataclass(frozen=True)
class CellHistory:
    """(n_sessions,) and (n_sessions, n_cells) arrays, the oldest session first; NaN where nothing was measured.

    Attributes:
        sessions: their ids.
        start_s: unix time.
        charge_ah: passed so far, out and in, as far as sessions told it.
        resistance: over that of the cell file where `is_absolute`, else over the median cell of the session.
        resistance_sigma: its standard deviation.
        capacity_ah: measured in this session alone.
        capacity_sigma_ah: its standard deviation.
        temperature_degc: mean of the session.
        rest_soc: at the first rest of the session, by the voltage.
        lost_per_day: SOC a day between the last rest of the session before and the first of this one.
        lost_sigma: its standard deviation.
        self_discharge_per_day: (n_cells,) SOC a day beyond the median, over all pauses.
        nominal_ah: of a new cell.
        is_present: where the module of today was in its place.
        is_absolute: whether resistances of different sessions compare.
        resistance_ohm: of a median cell, measured with its joint; NaN where nobody knows.
    """

    sessions: tuple[str, ...]
    start_s: FloatArray
    charge_ah: FloatArray
    resistance: FloatArray
    resistance_sigma: FloatArray
    capacity_ah: FloatArray
    capacity_sigma_ah: FloatArray
    temperature_degc: FloatArray
    rest_soc: FloatArray
    lost_per_day: FloatArray
    lost_sigma: FloatArray
    self_discharge_per_day: FloatArray
    nominal_ah: float
    is_present: BoolArray
    is_absolute: bool
    resistance_ohm: float = float("nan")

    @property
    def days(self) -> FloatArray:
        """(n_sessions,) since the first one."""
        return np.asarray((self.start_s - self.start_s[:1]) / DAY_S)

    @property
    def n_cells(self) -> int:
        """How many cells."""
        return int(self.resistance.shape[1])

    def today(self, values: FloatArray) -> FloatArray:
        """Return values of today's modules alone."""
        return np.where(self.is_present, values, np.nan)

    def only(self, sessions: set[str]) -> CellHistory:
        """Return the history of some sessions alone; charge counts on through the others."""
        rows = np.array([session in sessions for session in self.sessions], dtype=bool)
        cut = {
            name: value[rows]
            for name, value in vars(self).items()
            if isinstance(value, np.ndarray) and len(value) == len(rows) and name != "self_discharge_per_day"
        }
        return replace(self, sessions=tuple(each for each in self.sessions if each in sessions), **cut)

    def of(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return fractions of new and their sigmas: `resistance`, or `capacity`."""
        if name == "resistance":
            return self.today(self.resistance), self.resistance_sigma
        return self.today(self.capacity_ah / self.nominal_ah), self.capacity_sigma_ah / self.nominal_ah


def history_of(
    records: Sequence[SessionRecord],
    swaps: Sequence[Swap],
    results: Mapping[str, Mapping[str, Any]],
    cell: CellModel,
    n_cells: int,
) -> CellHistory:
    """Return the history out of passports' records and, by session, results of estimating again."""
    made = passports(records, swaps, cell.capacity_ah, cell.ocv.soc_at, n_cells)
    ordered = sorted(records, key=lambda record: record.start_s)
    shape = (len(ordered), n_cells)
    resistance, sigma, warm = (np.full(shape, np.nan) for _ in range(3))
    capacity = np.full((2, *shape), np.nan)
    charge = np.zeros(len(ordered))
    rest_soc, lost, lost_sigma = (np.full(shape, np.nan) for _ in range(3))
    for k, record in enumerate(ordered):
        if record.first_rest_s is not None:
            rest_soc[k] = rested_soc(record, "first", cell.ocv.soc_at)
        if k and (pause := lost_between(ordered[k - 1], record, cell.ocv.soc_at)) is not None:
            lost[k] = np.where(made.line[k] == made.line[k - 1], pause[0] / pause[1], np.nan)
            lost_sigma[k] = REST_SOC_SIGMA / pause[1]
    for k, record in enumerate(ordered):
        capacity[:, k] = capacity_in(record, n_cells)
        found = results.get(record.session_id)
        if found is not None and len(found["resistance_factor"]) == n_cells:
            resistance[k], sigma[k], warm[k] = (
                np.array(found[name], dtype=np.float64)
                for name in ("resistance_factor", "resistance_sigma", "temperature_degc")
            )
            charge[k] = found["charge_out_ah"] + found["charge_in_ah"]
    is_absolute = bool(np.isfinite(resistance).any())
    if not is_absolute:
        resistance = made.resistance_relative + 1.0
        sigma = np.where(np.isfinite(resistance), RELATIVE_SIGMA, np.nan)
    return CellHistory(
        made.sessions,
        made.times_s,
        np.cumsum(charge),
        resistance,
        sigma,
        capacity[0],
        capacity[1],
        warm,
        rest_soc,
        lost,
        lost_sigma,
        made.now("self_discharge_per_day") if len(ordered) else np.full(n_cells, np.nan),
        cell.capacity_ah,
        made.line == made.line_now,
        is_absolute,
        float(np.nanmedian(made.resistance_ohm)) if np.isfinite(made.resistance_ohm).any() else float("nan"),
    )


def capacity_in(record: SessionRecord, n_cells: int) -> FloatArray:
    """Return (2, n_cells) capacity and sigma [Ah] that a session told by itself: its stretches, each by its weight."""
    weight, total = np.zeros(n_cells), np.zeros(n_cells)
    for stretch in record.stretches:
        moved = np.abs(stretch.soc_moved)
        known = np.nan_to_num(moved) >= SOC_MOVED_MIN
        moved = np.where(known, moved, 1.0)
        each = abs(stretch.charge_ah) / moved
        variance = (stretch.charge_sigma_ah**2 + (each * stretch.soc_moved_sigma) ** 2) / moved**2
        weight += known / variance
        total += known * each / variance
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.array((total / weight, np.where(weight > 0.0, 1.0 / np.sqrt(weight), np.nan)))
