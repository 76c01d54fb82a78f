"""The measurements of every cell of a car, a row a session: what trends, curves and ranking are made of.

Cars share nothing, also where their accumulators are of one profile: each has a history of its own. What is in it are
facts of the season lake: resistance at the temperature and SOC of the moment, charge passed, capacity between rests,
SOC at rests. Swaps of modules are those of this car.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np

from app.battery.battery import Battery
from app.errors import ConfigError
from app.estimation.arrays import BoolArray, FloatArray, row_median
from app.estimation.cell_model.circuit import CellModel
from app.season.store import SeasonStore
from app.season.store.questions import ask
from app.sessions.info import SessionInfo
from app.sessions.swaps import Swap
from app.words import Message

DAY_S: Final = 86400.0
RELATIVE_SIGMA: Final = 0.01  # relative sigma of a resistance against the median cell, where unknown
REST_GAP_S: Final = 8 * 3600.0  # a shorter pause says nothing of self-discharge
REST_MOVED_MAX: Final = 0.03  # the median cell moved by more: the pack was used or charged unrecorded
REST_SOC_SIGMA: Final = 0.002  # sigma of the difference of two rests; the line finds how much pauses differ beyond it


@dataclass(frozen=True)
class CellHistory:
    """(n_sessions,) and (n_sessions, n_cells) arrays, the oldest session first; NaN where nothing was measured.

    Attributes:
        sessions: their ids.
        start_s: unix time.
        charge_ah: throughput so far, out and in [Ah].
        resistance_ohm: as measured, with the joint.
        resistance: over that of the cell file where `is_absolute`, else over the median cell of the session.
        resistance_sigma: its standard deviation.
        capacity_ah: measured in this session alone.
        capacity_sigma_ah: its standard deviation.
        rest_soc: at the first rest of the session, by the voltage.
        lost_per_day: SOC a day between the last rest of the session before and the first of this one.
        lost_sigma: its standard deviation.
        self_discharge_per_day: (n_cells,) SOC a day beyond the median, over all pauses.
        nominal_ah: of a new cell.
        module: how many modules were in the place before.
        is_present: where it is the module of today.
        is_absolute: whether resistances of different sessions compare.
        car: whose sessions they are, as the lake names it.
    """

    sessions: tuple[str, ...]
    start_s: FloatArray
    charge_ah: FloatArray
    resistance_ohm: FloatArray
    resistance: FloatArray
    resistance_sigma: FloatArray
    capacity_ah: FloatArray
    capacity_sigma_ah: FloatArray
    rest_soc: FloatArray
    lost_per_day: FloatArray
    lost_sigma: FloatArray
    self_discharge_per_day: FloatArray
    nominal_ah: float
    module: FloatArray
    is_present: BoolArray
    is_absolute: bool
    car: str = ""

    @property
    def days(self) -> FloatArray:
        """(n_sessions,) since the first one."""
        return np.asarray((self.start_s - self.start_s[:1]) / DAY_S)

    @property
    def n_cells(self) -> int:
        """Return the number of cells."""
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
        return replace(self, sessions=tuple(session for session in self.sessions if session in sessions), **cut)

    def measured(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return what was measured of the modules of then, and its sigmas.

        `resistance` and `capacity` are fractions of new, `self_discharge` is SOC a day beyond the median cell.
        """
        if name == "resistance":
            return self.resistance, self.resistance_sigma
        if name == "capacity":
            return self.capacity_ah / self.nominal_ah, self.capacity_sigma_ah / self.nominal_ah
        return self.lost_per_day - row_median(self.lost_per_day)[:, None], self.lost_sigma

    def of(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return the same of the modules of today alone."""
        values, sigmas = self.measured(name)
        return self.today(values), sigmas


@dataclass(frozen=True)
class SeasonSource:
    """A season: a lake and whose sessions of it. It can be sent to another process, which reads it there."""

    lake: str  # folder or URL
    battery: Battery
    is_simulated: bool
    cell: CellModel  # today's: a new cell's capacity
    swaps: tuple[Swap, ...] = ()

    def may_hold(self, info: SessionInfo) -> bool:
        """Return whether a session may be of this season: one that names no origin is the car's."""
        return (info.metadata.get("source") == "simulator") == self.is_simulated

    def histories(self, car: str = "") -> list[CellHistory]:
        """Ask the lake; return the history of each car, by name, or of the one that is named.

        Raises:
            ConfigError: the lake has other cars alone.
            ExtraMissing: the extra `season` is not installed.
            QueryFailed: a file of the lake is damaged, or a limit is passed.
        """
        histories = histories_of(SeasonStore(self.lake), self)
        if not car:
            return histories
        chosen = [history for history in histories if history.car == car]
        if histories and not chosen:
            raise ConfigError("car", car, Message("one-of", choices=tuple(history.car for history in histories)))
        return chosen


def histories_of(store: SeasonStore, source: SeasonSource) -> list[CellHistory]:
    """Return the history of a battery of each car out of a store's facts, in the order of their names.

    Raises:
        QueryFailed: see `SeasonStore.query`.
    """
    table = ask(
        store,
        "season_cells",
        battery=source.battery.name,
        segments=json.dumps(list(source.battery.segments)),
        simulated=str(int(source.is_simulated)),
    ).table
    cars = table.column("car").to_pylist()
    begins = [k for k, car in enumerate(cars) if k == 0 or car != cars[k - 1]]
    return [
        _history_of(table.slice(begin, end - begin), cars[begin], source)
        for begin, end in pairwise([*begins, len(cars)])
    ]


def _history_of(table: Any, car: str, source: SeasonSource) -> CellHistory:
    """The history of one car: rows by session and cell."""
    n_cells = source.battery.n_cells
    shape = (table.num_rows // n_cells, n_cells)

    def column(name: str) -> FloatArray:
        return _numbers(table.column(name)).reshape(shape)

    start_s = column("start_time")[:, 0]
    module, module_now = np.zeros(shape), np.zeros(n_cells)
    for swap in (swap for swap in source.swaps if swap.is_of(car)):
        is_swapped = np.isin(np.arange(n_cells), swap.cells)
        module += np.outer(start_s >= swap.time_s, is_swapped)
        module_now += is_swapped
    ohm = column("resistance_ohm")
    resistance, sigma = column("resistance_factor"), column("resistance_factor_sigma")
    is_absolute = bool(np.isfinite(resistance).any())
    if not is_absolute:
        resistance = ohm / row_median(ohm)[:, None]
        sigma = np.where(np.isfinite(resistance), RELATIVE_SIGMA, np.nan)
    rest_soc, lost, days = column("first_rest_soc"), np.full(shape, np.nan), np.full(shape, np.nan)
    last_soc = column("last_rest_soc")
    gaps_s = column("first_rest_time")[1:, 0] - column("last_rest_time")[:-1, 0]
    for k, gap_s in enumerate(gaps_s, 1):
        if (moved := lost_in_pause(last_soc[k - 1], rest_soc[k], gap_s)) is not None:
            is_same = module[k] == module[k - 1]
            lost[k, is_same], days[k, is_same] = moved[is_same], gap_s / DAY_S
    is_present = module == module_now
    return CellHistory(
        tuple(table.column("session").to_pylist()[::n_cells]),
        start_s,
        np.cumsum(np.nanmax(np.nan_to_num(column("charge_ah")), axis=1, initial=0.0)),
        ohm,
        resistance,
        sigma,
        column("capacity_ah"),
        column("capacity_sigma_ah"),
        rest_soc,
        lost / days,
        REST_SOC_SIGMA / days,
        _per_day(np.where(is_present, lost, np.nan), days),
        source.cell.capacity_ah,
        module,
        is_present,
        is_absolute,
        car,
    )


def lost_in_pause(last_soc: FloatArray, first_soc: FloatArray, gap_s: float) -> FloatArray | None:
    """Return (n_cells,) SOC lost in a pause; None where it is too short, or the pack was used or charged meanwhile.

    Args:
        last_soc: (n_cells,) at the rest before it.
        first_soc: (n_cells,) at the rest after it.
        gap_s: from one rest to the other.
    """
    lost = last_soc - first_soc
    finite = lost[np.isfinite(lost)]
    if not gap_s >= REST_GAP_S or not finite.size or abs(float(np.median(finite))) > REST_MOVED_MAX:
        return None
    return lost


def _numbers(column: Any) -> FloatArray:
    """A column as float64, NaN where nothing is known; times as unix seconds."""
    import pyarrow as pa

    if pa.types.is_timestamp(column.type):
        micros = column.cast(pa.timestamp("us", column.type.tz)).cast(pa.int64())
        return np.asarray(micros.cast(pa.float64()).to_numpy(), dtype=np.float64) / 1e6
    return np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64)


def _per_day(lost: FloatArray, days: FloatArray) -> FloatArray:
    """(n_cells,) SOC a day beyond the median cell of each pause, over all pauses."""
    beyond = lost - row_median(lost)[:, None]
    is_finite = np.isfinite(beyond)
    spent = np.where(is_finite, days, 0.0).sum(axis=0)
    return np.where(spent > 0.0, np.where(is_finite, beyond, 0.0).sum(axis=0) / np.maximum(spent, 1e-9), np.nan)


def newest_median(values: FloatArray, n_sessions: int) -> FloatArray:
    """Return (n_cells,) the median of each cell's newest values that are known; NaN where none is."""
    newest = [column[np.isfinite(column)][-n_sessions:] for column in values.T]
    return np.array([np.median(column) if column.size else np.nan for column in newest])
