"""The last quarter of an hour of the main values, for charts that open late."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.telemetry import Accumulator, Cells, FloatArray, Snapshot
from app.telemetry.encoding import is_stale
from app.telemetry.fields import Part, history_fields

LENGTH_S = 900
TOTALS_LENGTH = LENGTH_S * 28  # the line carries no more than 28 snapshots a second
CELLS_EVERY_NS = 180_000_000  # many cells fill memory: of more than two samples in this time, lowest and highest
CELLS_LENGTH = LENGTH_S * 12  # rows, two for each such time
TOTALS = {
    name: part for name, _, part in history_fields(Accumulator)
}  # and the part of the measurement that dates each


@dataclass(frozen=True)
class Quantisation:
    """Coding of a cell's value in 16 bits: counts of `step` from `zero`; half the memory of a float."""

    step: float
    zero: float = 0.0
    part: Part = "voltage"  # part of the measurement whose age dates it

    def of(self, values: FloatArray) -> NDArray[np.int16]:
        """Values as counts, held at the ends; NaN as MISSING."""
        with np.errstate(invalid="ignore"):
            counts = np.clip(np.rint((values - self.zero) / self.step), -32767, 32767)
        return np.where(np.isnan(counts), MISSING, counts).astype(np.int16)

    def value(self, counts: NDArray[np.int16]) -> FloatArray:
        """Counts as values."""
        return np.where(counts == MISSING, np.nan, counts * self.step + self.zero)


MISSING = -32768
STEPS = {"V": 1e-4, "degC": 0.01, "1": 4e-5}  # by unit; of voltages as fine as they are measured
MIDDLE = {"voltage_v": 3.0}  # 16 bits reach 3.28 V up and down from it
PER_CELL = {
    name: Quantisation(STEPS[unit.unit], MIDDLE.get(name, 0.0), part) for name, unit, part in history_fields(Cells)
}
_PARTS = {*TOTALS.values(), *(scale.part for scale in PER_CELL.values())}


class _Ring:
    """Columns of one length with the monotonic time of each row; they take memory when they are used."""

    def __init__(self, columns: Mapping[str, NDArray[Any]]) -> None:
        self._columns = columns
        self._length = len(next(iter(columns.values())))
        self._count = 0
        self._t_ns = np.empty(self._length, dtype=np.int64)

    @property
    def newest_ns(self) -> int | None:
        return int(self._t_ns[(self._count - 1) % self._length]) if self._count else None

    def add(self, t_ns: int, values: Mapping[str, Any]) -> None:
        row = self._count % self._length
        self._t_ns[row] = t_ns
        for name, column in self._columns.items():
            column[row] = values[name]
        self._count += 1

    def since(self, from_ns: int, cell: int | None) -> tuple[NDArray[np.int64], dict[str, NDArray[Any]]]:
        n = min(self._count, self._length)
        order = np.arange(self._count - n, self._count) % self._length
        order = order[self._t_ns[order] >= from_ns]
        place = order if cell is None else (order, cell)
        return self._t_ns[order], {name: column[place] for name, column in self._columns.items()}


class History:
    """Rings of fixed size; thread-safe.

    Kept by the monotonic clock and dated by the wall clock of the newest, so that a wall clock that is set while the
    service runs neither folds the time axis nor empties it.
    """

    def __init__(self, n_cells: int) -> None:
        self._n_cells = n_cells
        self._lock = threading.Lock()
        self._totals = _Ring({name: np.empty(TOTALS_LENGTH, np.float32) for name in TOTALS})
        self._cells = _Ring({name: np.empty((CELLS_LENGTH, n_cells), np.int16) for name in PER_CELL})
        self._held: list[tuple[int, dict[str, NDArray[np.int16]]]] = []  # samples of cells that are not in the ring yet
        self._wall_minus_mono_ns = 0

    def add(self, snapshot: Snapshot) -> None:
        """Keep a snapshot that was made from new bytes."""
        if not snapshot.is_fresh:
            return
        t_ns = snapshot.t_mono_ns
        with self._lock:
            self._wall_minus_mono_ns = snapshot.t_wall_ns - t_ns
            old = {part for part in _PARTS if is_stale(snapshot, part)}  # another link may have brought the snapshot
            total = snapshot.accumulator
            totals = ((name, None if part in old else getattr(total, name)) for name, part in TOTALS.items())
            self._totals.add(t_ns, {name: np.nan if value is None else value for name, value in totals})
            if self._held and t_ns - self._held[0][0] >= CELLS_EVERY_NS:
                self._keep_held()
            counts = {
                name: np.full(self._n_cells, MISSING, np.int16)
                if scale.part in old
                else scale.of(getattr(snapshot.cells, name))
                for name, scale in PER_CELL.items()
            }
            self._held.append((t_ns, counts))

    def _keep_held(self) -> None:
        """Move what is held into the ring: one or two samples as they are, more as their lowest and highest."""
        held, self._held = self._held, []
        if len(held) <= 2:
            for t_ns, counts in held:
                self._cells.add(t_ns, counts)
            return
        stacks = {name: np.stack([counts[name] for _, counts in held]) for name in PER_CELL}
        self._cells.add(held[0][0], {name: _lowest(stack) for name, stack in stacks.items()})
        self._cells.add(held[-1][0], {name: stack.max(axis=0) for name, stack in stacks.items()})

    def read(self, seconds: float, cell: int | None, points: int = 2000) -> dict[str, Any]:
        """Return {"time", "series"} of the last `seconds`; more than `points` are thinned, extremes kept."""
        with self._lock:
            if cell is not None:
                self._keep_held()
            ring = self._totals if cell is None else self._cells
            t_ns, columns = ring.since((ring.newest_ns or 0) - int(seconds * 1e9), cell)
            time_s = (t_ns + self._wall_minus_mono_ns) / 1e9
        if cell is None:
            values = {name: column.astype(np.float64) for name, column in columns.items()}
        else:
            values = {name: PER_CELL[name].value(counts) for name, counts in columns.items()}
        if len(time_s) > points:
            time_s, values = _thin(time_s, values, points)
        digits = {name: np.round(column, 5) for name, column in values.items()}
        return {"time": time_s, "series": digits}


def _lowest(stack: NDArray[np.int16]) -> NDArray[np.int16]:
    """Lowest of (samples, cells) that is not missing; MISSING is the smallest count there is."""
    lowest = np.where(stack == MISSING, np.iinfo(np.int16).max, stack).min(axis=0)
    return np.where((stack == MISSING).all(axis=0), MISSING, lowest).astype(np.int16)


def _thin(time_s: FloatArray, columns: dict[str, FloatArray], points: int) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Two values a bucket, lowest and highest, at the bucket's first and last time."""
    buckets = points // 2
    edges = np.linspace(0, len(time_s), buckets + 1).astype(int)
    out_time = np.stack([time_s[edges[:-1]], time_s[edges[1:] - 1]], axis=1).ravel()
    thinned = {}
    for name, values in columns.items():
        filled_low = np.where(np.isnan(values), np.inf, values)
        filled_high = np.where(np.isnan(values), -np.inf, values)
        low = np.minimum.reduceat(filled_low, edges[:-1])
        high = np.maximum.reduceat(filled_high, edges[:-1])
        both = np.stack([low, high], axis=1).ravel()
        thinned[name] = np.where(np.isinf(both), np.nan, both)
    return out_time, thinned
