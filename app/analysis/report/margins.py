"""How near a run came to the limits of then: each stretch is judged by the configuration that was in force in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from app.analysis.report.findings import NEAR, LimitName, Margin, margins
from app.analysis.survey import Piece, Survey, keep_extreme


class MarginWatch:
    """Takes a recording piece by piece, in order; `add` can be the `also` of `survey_session`."""

    def __init__(self, n_cells: int, in_force: Sequence[tuple[float, Mapping[str, float]]]) -> None:
        """Judge by the limits in force, by name, each since a unix time, in order; the first since ever."""
        self._since_s = [since_s for since_s, _ in in_force[1:]]
        self._limits = [dict(limits) for _, limits in in_force] or [{}]
        self._spans = [_empty(n_cells) for _ in self._limits]

    def add(self, piece: Piece) -> None:
        """Take the next piece."""
        edges = [0, *np.searchsorted(piece.time_s, self._since_s).tolist(), len(piece.time_s)]
        for span, first, last in zip(self._spans, edges[:-1], edges[1:], strict=True):
            if last > first:
                _keep(span, piece, slice(first, last))

    def nearest(self) -> list[Margin]:
        """Return how near every known limit came, each by its nearest stretch, the nearest first."""
        found: dict[LimitName, Margin] = {}
        for span, limits in zip(self._spans, self._limits, strict=True):
            for each in margins(span, limits):
                if each.limit not in found or each.margin < found[each.limit].margin:
                    found[each.limit] = each
        return sorted(found.values(), key=lambda each: each.margin / NEAR[each.limit])


def _empty(n_cells: int) -> Survey:
    nan = np.full(n_cells, np.nan)
    return Survey(
        n_cells,
        voltage_min_v=nan.copy(),
        voltage_min_at_s=nan.copy(),
        voltage_max_v=nan.copy(),
        temperature_max_degc=nan.copy(),
        temperature_max_at_s=nan.copy(),
    )


def _keep(span: Survey, piece: Piece, rows: slice) -> None:
    time_s, volts, degc = piece.time_s[rows], piece.voltage_v[rows], piece.temperature_degc[rows]
    keep_extreme(span.voltage_min_v, span.voltage_min_at_s, volts, time_s, lowest=True)
    keep_extreme(span.temperature_max_degc, span.temperature_max_at_s, degc, time_s, lowest=False)
    span.voltage_max_v = np.fmax(span.voltage_max_v, np.fmax.reduce(volts, axis=0))
    current = np.nan_to_num(piece.current_a[rows])
    span.current_max_a = max(span.current_max_a, float(current.max()))
    span.current_min_a = min(span.current_min_a, float(current.min()))
