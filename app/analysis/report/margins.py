"""How near a run came to the limits of then: each stretch is judged by the configuration that was in force in it."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.analysis.limits import LimitsOverTime, MovingLimit
from app.analysis.report.findings import LOWEST_ALLOWED, NEAR, LimitName, Margin, margin_of, margins
from app.analysis.survey import Piece, Survey, keep_extreme

_NAMES: Final[dict[str, LimitName]] = {
    "v_cell_min": "v_min",
    "v_cell_max": "v_max",
    "t_cell_max": "t_max",
    "i_disc_max": "i_max",
    "i_disc_min": "i_min",
}


class MarginWatch:
    """Takes a recording piece by piece, in order; `add` can be the `also` of `survey_session`."""

    def __init__(self, n_cells: int, limits: LimitsOverTime) -> None:
        """Judge by the limits in force; the first set since ever, those that signals carry moment by moment."""
        self._since_s = [since_s for since_s, _ in limits.in_force[1:]]
        self._limits = [each for _, each in limits.in_force] or [{}]
        self._moving = limits.moving
        self._nearest: dict[LimitName, Margin] = {}  # to those that signals carry
        self._spans = [_empty(n_cells) for _ in self._limits]

    def add(self, piece: Piece) -> None:
        """Take the next piece."""
        edges = [0, *np.searchsorted(piece.time_s, self._since_s).tolist(), len(piece.time_s)]
        for span, first, last in zip(self._spans, edges[:-1], edges[1:], strict=True):
            if last > first:
                _keep(span, piece, slice(first, last))
        for name, moving in self._moving.items():
            if name in _NAMES:
                self._keep_nearest(_nearest_to(moving, _NAMES[name], piece))

    def _keep_nearest(self, found: Margin | None) -> None:
        if found is not None:
            before = self._nearest.get(found.limit)
            if before is None or found.margin < before.margin:
                self._nearest[found.limit] = found

    def nearest(self) -> list[Margin]:
        """Return how near every known limit came, each by its nearest stretch, the nearest first."""
        found = dict(self._nearest)
        for span, limits in zip(self._spans, self._limits, strict=True):
            for each in margins(span, limits):
                if each.limit not in found or each.margin < found[each.limit].margin:
                    found[each.limit] = each
        return sorted(found.values(), key=lambda each: each.margin / NEAR[each.limit])


def _nearest_to(moving: MovingLimit, limit: LimitName, piece: Piece) -> Margin | None:
    """How near a piece came to a limit that moves: the instant at which the value was nearest, not the extreme."""
    allowed = moving.at(piece.time_s)
    tables = {"v_min": piece.voltage_v, "v_max": piece.voltage_v, "t_max": piece.temperature_degc}
    values = tables.get(limit, piece.current_a[:, None])
    left = values - allowed[:, None] if limit in LOWEST_ALLOWED else allowed[:, None] - values
    if not np.isfinite(left).any():
        return None
    row, column = np.unravel_index(np.nanargmin(left), left.shape)
    cell = int(column) if limit in tables else None
    return margin_of(limit, float(values[row, column]), float(allowed[row]), cell, float(piece.time_s[row]))


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
