"""Slow trends of each cell, over hours: resistance, joint, time spent balancing."""

import threading
from typing import Any

import numpy as np

from app.telemetry import Cells, FloatArray, Snapshot
from app.telemetry.fields import TREND, marked

EVERY_S = 10.0
LENGTH = round(6 * 3600 / EVERY_S)  # rows
LONGEST_STEP_S = 2.0  # between two snapshots; a longer one counts as no time
NAMES = marked(Cells, TREND)


class Trend:
    """One row every ten seconds for six hours, each the mean of what came in between; thread-safe."""

    def __init__(self, n_cells: int) -> None:
        self._n_cells = n_cells
        self._lock = threading.Lock()
        self._t_ns = np.empty(LENGTH, np.int64)
        self._rows = np.empty((LENGTH, len(NAMES), n_cells), np.float32)
        self._count = 0
        self._sum: FloatArray = np.zeros((len(NAMES), n_cells))
        self._weight: FloatArray = np.zeros((len(NAMES), n_cells))
        self._since_ns: int | None = None
        self._before_ns: int | None = None
        self._balanced_s: FloatArray = np.zeros(n_cells)
        self._wall_minus_mono_ns = 0

    def add(self, snapshot: Snapshot) -> None:
        """Take a snapshot that was made from new bytes."""
        if not snapshot.is_fresh:
            return
        cells, t_ns = snapshot.cells, snapshot.t_mono_ns
        balancing = np.full(self._n_cells, np.nan) if cells.balancing is None else cells.balancing.astype(np.float64)
        values = np.stack([balancing if name == "balancing" else getattr(cells, name) for name in NAMES])
        is_known = ~np.isnan(values)
        with self._lock:
            step_s = 0.0 if self._before_ns is None else (t_ns - self._before_ns) / 1e9
            if 0 < step_s <= LONGEST_STEP_S:
                self._balanced_s += step_s * np.nan_to_num(balancing)
            self._before_ns = t_ns
            self._wall_minus_mono_ns = snapshot.t_wall_ns - t_ns
            if self._since_ns is None:
                self._since_ns = t_ns
            self._sum += np.where(is_known, values, 0.0)
            self._weight += is_known
            if (t_ns - self._since_ns) / 1e9 >= EVERY_S:
                row = self._count % LENGTH
                self._t_ns[row] = t_ns
                with np.errstate(invalid="ignore", divide="ignore"):
                    self._rows[row] = self._sum / self._weight  # NaN where nothing was known
                self._count += 1
                self._since_ns = t_ns
                self._sum, self._weight = np.zeros_like(self._sum), np.zeros_like(self._weight)

    def read(self, cell: int) -> dict[str, Any]:
        """Return {"time", "series", "balanced_s"} of a cell; balanced_s since the service started [s]."""
        with self._lock:
            n = min(self._count, LENGTH)
            order = np.arange(self._count - n, self._count) % LENGTH
            time_s = (self._t_ns[order] + self._wall_minus_mono_ns) / 1e9
            rows = self._rows[order, :, cell].astype(np.float64)
            balanced_s = float(self._balanced_s[cell])
        series = {name: np.round(rows[:, i], 7) for i, name in enumerate(NAMES)}
        return {"time": time_s, "series": series, "balanced_s": round(balanced_s, 1)}
