"""From a session's file to the arrays that analysis works on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from app.analysis.totals import Totals
from app.estimation.arrays import FloatArray, latest_at
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.series import FieldSamples

_SOC = "estimate.soc"
TOTALS_FIELDS = ("i_fs", "v_tot", "v_min", "v_min_id", "v_max", "t_max", "t_max_id", "t_avg", "soc", _SOC)


def read_totals(session: SessionFile, t_from_s: float | None = None, t_to_s: float | None = None) -> Totals:
    """Return the accumulator over a range of unix time; what a session does not hold is NaN throughout."""
    collector = TotalsCollector(session.battery.n_cells)
    for found in session.fields(TOTALS_FIELDS, t_from_s, t_to_s):
        collector.add(found)
    return collector.totals()


class TotalsCollector:
    """Takes what a session holds of TOTALS_FIELDS, piece by piece in order."""

    def __init__(self, n_cells: int) -> None:
        self._n_cells = n_cells
        self._pieces: dict[str, list[FieldSamples]] = {}

    def add(self, found: Mapping[str, FieldSamples]) -> None:
        """Take the next piece; other fields are passed over."""
        for name in TOTALS_FIELDS:
            samples = found.get(name)
            if samples is not None:
                if name == _SOC:
                    samples = FieldSamples(samples.time_s, _row_means(samples.values)[:, None])
                self._pieces.setdefault(name, []).append(samples)

    def totals(self) -> Totals:
        """Return the accumulator over all pieces.

        The state of charge is the mean of what was estimated then, the master's own count where nothing was.
        """
        series = {name: _joined(parts) for name, parts in self._pieces.items()}
        time_s = series["i_fs"][0] if "i_fs" in series else _longest(series)
        column = {name: latest_at(time_s, *series[name]) if name in series else _none(time_s) for name in TOTALS_FIELDS}
        for name, cell in (("v_min", "v_min_id"), ("t_max", "t_max_id")):
            column[cell] = np.where((column[cell] < self._n_cells) & np.isfinite(column[name]), column[cell], np.nan)
        measured = column["v_min"] > 0.0  # 0 V: no cell was measured
        return Totals(
            time_s=time_s,
            current_a=column["i_fs"],
            voltage_v=np.where(column["v_tot"] > 0.0, column["v_tot"], np.nan),
            v_min_v=np.where(measured, column["v_min"], np.nan),
            v_min_cell=np.where(measured, column["v_min_id"], np.nan),
            v_max_v=np.where(measured, column["v_max"], np.nan),
            t_max_degc=_degrees(column["t_max"]),
            t_max_cell=column["t_max_id"],
            t_mean_degc=_degrees(column["t_avg"]),
            soc=np.where(np.isfinite(column[_SOC]), column[_SOC], column["soc"]),
        )


def _degrees(values: FloatArray) -> FloatArray:
    return np.where(values > -128.0, values, np.nan)


def _row_means(values: FloatArray) -> FloatArray:
    known = np.isfinite(values)
    count = known.sum(axis=1)
    total = np.where(known, values, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _joined(parts: Sequence[FieldSamples]) -> tuple[FloatArray, FloatArray]:
    return np.concatenate([part.time_s for part in parts]), np.concatenate([part.values[:, 0] for part in parts])


def _longest(series: dict[str, tuple[FloatArray, FloatArray]]) -> FloatArray:
    return max((times for times, _ in series.values()), key=len, default=np.empty(0))


def _none(time_s: FloatArray) -> FloatArray:
    return np.full(len(time_s), np.nan)
