"""Findings of a recorded session, by the judge that judges live: an old session gains what is new in it."""

from __future__ import annotations

from bisect import bisect_right
from copy import deepcopy
from typing import Final

import numpy as np

from app.analysis.session_cell import cell_of
from app.analysis.session_survey import read_pieces
from app.analysis.survey import SurveyPiece
from app.estimation.arrays import BoolArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.cell_finding import CellFinding
from app.estimation.health.cell_watch import JUDGE_S, CellWatch, CellWatchMemory
from app.sessions.reading.reader import SessionFile

SPACED_S: Final = 0.09  # nothing is gained from quicker samples
KEPT_S: Final = 60.0  # seconds of a recording between two kept states


class CellJudge:
    """Takes a session piece by piece, in order; give `add` to `survey_session` as `also`."""

    def __init__(self, cell: CellModel, segments: tuple[int, ...], memory: CellWatchMemory | None = None) -> None:
        self.watch = CellWatch(cell, segments, memory)
        self._before_s: float | None = None
        self._judged_s = -np.inf
        self._history: list[tuple[float, tuple[CellFinding, ...]]] = []

    def add(self, piece: SurveyPiece) -> None:
        """Take the next piece."""
        balancing: BoolArray = np.asarray(piece.balancing) > 0.0
        knows_balancing: BoolArray = np.asarray(np.isfinite(piece.balancing).all(axis=1))
        fresh_voltage_v = piece.fresh_voltage_v
        for k, time_s in enumerate(piece.time_s.tolist()):
            dt_s = 0.0 if self._before_s is None else time_s - self._before_s
            if self._before_s is not None and 0.0 <= dt_s < SPACED_S:
                continue
            self._before_s = time_s
            if dt_s < 0.0:  # the clock was set back: how long it took is not known, and what follows counts
                dt_s, self._judged_s = 0.0, min(self._judged_s, time_s)
            self.watch.step(
                time_s,
                dt_s,
                float(piece.current_a[k]),
                fresh_voltage_v[k],
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
        at = bisect_right(self._history, time_s, key=lambda entry: entry[0])
        return self._history[at - 1][1] if at else ()

    def ended(self) -> tuple[CellFinding, ...]:
        """Return what was found and ended by evidence, as it was last seen."""
        left = {(finding.code, finding.cell) for finding in self.watch.findings}
        seen = {(finding.code, finding.cell): finding for _, findings in self._history for finding in findings}
        return tuple(finding for key, finding in seen.items() if key not in left)

    def _judge(self, time_s: float) -> None:
        self._judged_s = time_s
        findings = self.watch.judge()
        if not self._history or findings != self._history[-1][1]:
            since_s = max(time_s, self._history[-1][0]) if self._history else time_s
            self._history.append((since_s, findings))


class WatchAlong:
    """The watch of a session's cells as it stood at any of its moments. What was read once is not read again."""

    def __init__(self, session: SessionFile, cell: CellModel) -> None:
        self._session = session
        self._start = CellJudge(cell, session.battery.segments)
        self._states: list[tuple[float, CellJudge]] = []  # as they stood at unix times, in order

    def at(self, time_s: float) -> CellWatch:
        """Return a watch that has seen everything up to a unix time [s]; it is the caller's own."""
        k = bisect_right(self._states, time_s, key=lambda entry: entry[0])
        since_s, watch = self._states[k - 1] if k else (None, self._start)
        judge = deepcopy(watch)
        for piece in read_pieces(self._session, from_s=since_s, to_s=time_s):
            judge.add(piece)
            last_s = float(piece.time_s[-1])
            if not self._states or last_s - self._states[-1][0] >= KEPT_S:
                self._states.append((last_s, deepcopy(judge)))
        return judge.watch


def cell_findings(session: SessionFile, cell: CellModel | None = None) -> tuple[CellFinding, ...]:
    """Read a session and return what is wrong with its cells at its end, the surest first."""
    judge = CellJudge(cell or cell_of(session)[0], session.battery.segments)
    for piece in read_pieces(session):
        judge.add(piece)
    return judge.result()
