"""What a recorded session shows of its cells, by the judge that judges live: an old session gains what is new in it."""

from __future__ import annotations

from bisect import bisect_right
from typing import Final

import numpy as np

from app.analysis.session_survey import read_pieces
from app.analysis.survey import Piece
from app.battery.shape import CELLS_PER_PACK, N_PACKS
from app.estimation.arrays import BoolArray
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.cell_finding import CellFinding
from app.estimation.health.cell_watch import JUDGE_S, CellWatch, CellWatchMemory
from app.sessions.reading.reader import SessionFile

SPACED_S: Final = 0.09  # nothing is gained from quicker samples


class CellJudge:
    """Takes a session piece by piece, in order; give `add` to `survey_session` as `also`."""

    def __init__(self, cell: CellModel, memory: CellWatchMemory | None = None) -> None:
        self.watch = CellWatch(cell, (CELLS_PER_PACK,) * N_PACKS, memory)
        self._before_s: float | None = None
        self._judged_s = -np.inf
        self._history: list[tuple[float, tuple[CellFinding, ...]]] = []

    def add(self, piece: Piece) -> None:
        """Take the next piece."""
        balancing: BoolArray = np.asarray(piece.balancing) > 0.0
        knows_balancing: BoolArray = np.asarray(np.isfinite(piece.balancing).all(axis=1))
        for k, time_s in enumerate(piece.time_s.tolist()):
            dt_s = 0.0 if self._before_s is None else max(time_s - self._before_s, 0.0)
            if self._before_s is not None and dt_s < SPACED_S:
                continue
            self._before_s = time_s
            self.watch.step(
                time_s,
                dt_s,
                float(piece.current_a[k]),
                piece.voltage_v[k],
                piece.temperature_degc[k],
                balancing[k] if knows_balancing[k] else None,
            )
            if time_s - self._judged_s >= JUDGE_S:
                self._judge(time_s)

    def result(self) -> tuple[CellFinding, ...]:
        """Return what is wrong at the end of what was taken, the surest first; times are unix time."""
        if self._before_s is not None:
            self._judge(self._before_s)
        return self.watch.findings

    def as_of(self, time_s: float) -> tuple[CellFinding, ...]:
        """Return what was known at a time [unix s]."""
        at = bisect_right(self._history, time_s, key=lambda each: each[0])
        return self._history[at - 1][1] if at else ()

    def ended(self) -> tuple[CellFinding, ...]:
        """Return what was found and ended by evidence, as it was last seen."""
        left = {(each.code, each.cell) for each in self.watch.findings}
        seen = {(each.code, each.cell): each for _, found in self._history for each in found}
        return tuple(each for key, each in seen.items() if key not in left)

    def _judge(self, time_s: float) -> None:
        self._judged_s = time_s
        found = self.watch.judge()
        if not self._history or found != self._history[-1][1]:
            self._history.append((time_s, found))


def cell_findings(session: SessionFile, cell: CellModel | None = None) -> tuple[CellFinding, ...]:
    """Read a session and return what is wrong with its cells at its end, the surest first."""
    judge = CellJudge(cell or load_cell())
    for piece in read_pieces(session):
        judge.add(piece)
    return judge.result()
