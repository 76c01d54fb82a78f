"""The last quarter of an hour of the main values, for charts that open late."""

import threading
from typing import Any

import numpy as np

from app.telemetry import FloatArray, Snapshot
from firmware_protocol.memory_map import N_CELLS

CAPACITY = 9000  # 15 minutes at 10 Hz
TOTALS = (
    "voltage_v",
    "current_a",
    "power_w",
    "soc",
    "driver_soc_percent",
    "soc_sigma",
    "soc_min",
    "soc_max",
    "voltage_min_v",
    "voltage_max_v",
    "voltage_delta_v",
    "temperature_min_degc",
    "temperature_max_degc",
)
PER_CELL = ("voltage_v", "temperature_degc", "soc", "soc_sigma", "residual_v")


class History:
    """Rings of fixed size; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0
        self._time_s = np.full(CAPACITY, np.nan)
        self._totals = {name: np.full(CAPACITY, np.nan) for name in TOTALS}
        self._cells = {name: np.full((CAPACITY, N_CELLS), np.nan, dtype=np.float32) for name in PER_CELL}

    def add(self, snapshot: Snapshot) -> None:
        """Keep a snapshot that was made from new bytes."""
        if not snapshot.is_fresh:
            return
        with self._lock:
            place = self._count % CAPACITY
            self._time_s[place] = snapshot.t_wall_ns / 1e9
            for name, ring in self._totals.items():
                value = snapshot.accumulator[name]
                ring[place] = np.nan if value is None else value
            for name, block in self._cells.items():
                block[place] = getattr(snapshot.cells, name)
            self._count += 1

    def read(self, seconds: float, cell: int | None, points: int = 2000) -> dict[str, Any]:
        """Return {"time", "series"} of the last `seconds`; more than `points` are thinned, extremes kept."""
        with self._lock:
            n = min(self._count, CAPACITY)
            order = np.arange(self._count - n, self._count) % CAPACITY
            time_s = self._time_s[order]
            columns = (
                {name: ring[order] for name, ring in self._totals.items()}
                if cell is None
                else {name: block[order, cell].astype(np.float64) for name, block in self._cells.items()}
            )
        recent = time_s >= (time_s[-1] - seconds if n else 0)
        time_s = time_s[recent]
        keep = {name: values[recent] for name, values in columns.items()}
        if len(time_s) > points:
            time_s, keep = _thin(time_s, keep, points)
        return {"time": time_s, "series": keep}


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
