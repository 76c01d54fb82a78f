"""The accumulator over a whole recording, in as few points as a chart on paper can show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.analysis.totals import MAX_STEP_S, Totals, listed
from app.estimation.arrays import FloatArray

POINTS: Final = 600


@dataclass(frozen=True)
class OverTime:
    """Lists of one length: each entry is a part of the recording; None where nothing was measured.

    Attributes:
        time_s: seconds from the first sample, rising.
        power_min_w, power_mean_w, power_max_w: out of the accumulator [W].
        voltage_min_v, voltage_max_v: lowest and highest cell [V].
        soc: mean of all cells, 0..1.
        temperature_mean_degc, temperature_max_degc: mean of all cells, and hottest cell [degC].
    """

    time_s: list[float]
    power_min_w: list[float | None]
    power_mean_w: list[float | None]
    power_max_w: list[float | None]
    voltage_min_v: list[float | None]
    voltage_max_v: list[float | None]
    soc: list[float | None]
    temperature_mean_degc: list[float | None]
    temperature_max_degc: list[float | None]


def over_time(totals: Totals) -> OverTime:
    """Return the recording in about POINTS parts; no extreme of a part is lost, and a gap is a part of its own."""
    n = len(totals.time_s)
    gaps = np.flatnonzero(np.diff(totals.time_s) > MAX_STEP_S) + 1
    with_gaps = n + len(gaps)

    def column(values: FloatArray) -> FloatArray:
        return np.insert(values, gaps, np.nan)

    gap_rows = gaps + np.arange(len(gaps))
    starts = np.linspace(0, with_gaps, min(POINTS, with_gaps) + 1)[:-1].astype(np.intp)
    starts = np.unique(np.concatenate((starts, gap_rows, gap_rows + 1)))
    time_s = np.insert(totals.time_s, gaps, totals.time_s[gaps - 1] + MAX_STEP_S)
    power_w = column(totals.power_w)

    def lowest(values: FloatArray, decimals: int) -> list[float | None]:
        return listed(np.fmin.reduceat(values, starts) if n else values, decimals)

    def highest(values: FloatArray, decimals: int) -> list[float | None]:
        return listed(np.fmax.reduceat(values, starts) if n else values, decimals)

    def mean(values: FloatArray, decimals: int) -> list[float | None]:
        return listed(_means(values, starts) if n else values, decimals)

    return OverTime(
        time_s=(time_s[starts] - totals.time_s[0]).round(2).tolist() if n else [],
        power_min_w=lowest(power_w, 0),
        power_mean_w=mean(power_w, 0),
        power_max_w=highest(power_w, 0),
        voltage_min_v=lowest(column(totals.v_min_v), 4),
        voltage_max_v=highest(column(totals.v_max_v), 4),
        soc=mean(column(totals.soc), 4),
        temperature_mean_degc=mean(column(totals.t_mean_degc), 1),
        temperature_max_degc=highest(column(totals.t_max_degc), 1),
    )


def _means(values: FloatArray, starts: NDArray[np.intp]) -> FloatArray:
    """The mean of what is known in each part, NaN where nothing is."""
    is_finite = np.isfinite(values)
    count = np.add.reduceat(is_finite.astype(np.int64), starts)
    total = np.add.reduceat(np.where(is_finite, values, 0.0), starts)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
