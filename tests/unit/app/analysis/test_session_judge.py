"""Findings of a recorded session: as of any moment, and with a clock that was set back."""

from dataclasses import replace

import numpy as np
import pytest

from app.analysis.session_judge import CellJudge, WatchAlong
from app.analysis.session_survey import read_pieces
from app.estimation.cell_model.cell_file import load_cell
from app.sessions.reading.reader import SessionFile
from tests.recorded.arrays import START_S

CELL = load_cell("samsung-25r-10p")
STUCK = 30
TIME_S = np.arange(0.0, 200.0, 0.5)
CURRENT_A = np.where(TIME_S > 5, 60 + 50 * np.sin(TIME_S), 0.0)


@pytest.fixture
def session(make_session):
    """A channel stands still from 60 s to 120 s, while the car drives."""
    volts = 3.7 - CURRENT_A[:, None] * np.full(96, 0.002)
    held = (TIME_S > 60) & (TIME_S < 120)
    volts[held, STUCK] = 3.65
    with SessionFile(make_session(TIME_S, CURRENT_A, volts)) as file:
        yield file


def stuck(watch):
    return [each.cell for each in watch.judge() if each.code == "cell-voltage-stuck"]


def test_a_watch_stands_as_it_stood_then_in_whatever_order_it_is_asked(session):
    along = WatchAlong(session, CELL)
    for at_s, expected in ((110.0, [STUCK]), (50.0, []), (180.0, []), (110.0, [STUCK])):
        assert stuck(along.at(START_S + at_s)) == expected


def test_a_watch_that_was_handed_out_is_the_callers_own(session):
    along = WatchAlong(session, CELL)
    first = along.at(START_S + 110.0)
    first.step(START_S + 1e6, 1000.0, 0.0, np.full(96, 3.0), np.full(96, 25.0))
    assert stuck(along.at(START_S + 110.0)) == [STUCK]


def test_a_clock_that_is_set_back_hides_nothing(session):
    """An hour back in the middle: what follows is judged at once, and not only when the clock has caught up."""
    judge = CellJudge(CELL, (12,) * 8)
    for piece in read_pieces(session):
        late = piece.time_s >= START_S + 30.0
        judge.add(replace(piece, time_s=np.where(late, piece.time_s - 3600.0, piece.time_s)))
    judge.result()
    assert [each.cell for each in judge.ended() if each.code == "cell-voltage-stuck"] == [STUCK]
