"""What the judge had found while a session was recorded may explain a trip."""

from types import SimpleNamespace

import pytest

from app.analysis.incidents import Trigger
from app.analysis.root_cause.from_session import causes_without_trip, found_live
from app.analysis.root_cause.judge import Judgement, judge
from app.analysis.root_cause.recording import Hypothesis
from app.words import Message, Pack

FOUND = Message("seen-slave-silent", pack=Pack(0))


def event(code, cell, at_s):
    return Trigger(at_s, at_s, code, "warning", FOUND, cell)


TRIP = Trigger(100.0, 100.0, "trip-cell-undervoltage", "trip", Message("cell-undervoltage"), 40, 2.4, 2.5, "V")


def causes(*events):
    (found,) = judge([TRIP], found_live(SimpleNamespace(events=events)), [12] * 8)
    return [(each.code, each.cell, each.evidence) for each in found.ranked]


def test_a_finding_of_the_tripped_cell_is_its_cause_and_one_of_another_pack_is_not():
    events = event("finding-joint-resistance-high", 40, 90.0), event("finding-capacity-low", 3, 90.0)
    assert causes(*events) == [("joint-resistance-high", 40, (FOUND,))]


def test_what_evidence_had_ended_or_no_judge_found_explains_nothing():
    ended = event("finding-joint-resistance-high", 40, 50.0), event("finding-ended", 40, 60.0)
    assert causes(*ended, event("cell-voltage-missing", 40, 90.0)) == []


def judged(monkeypatch, *hypotheses):
    """Let the judge find these, each by itself."""
    found = [Judgement(each.at_s, None, (each,), (0.9,)) for each in hypotheses]
    monkeypatch.setattr("app.analysis.root_cause.from_session._judged", lambda *_: found)


def recorded(make_session, until_s, *events, current_a=50.0):
    time_s = [0.0, until_s]
    return make_session(time_s, [current_a, current_a], events=events, closed=False)


@pytest.mark.parametrize(("current_a", "found"), [(50.0, []), (1.0, None)])
def test_a_car_that_stands_says_nothing_against_what_current_showed(make_session, monkeypatch, current_a, found):
    judged(monkeypatch)
    assert causes_without_trip(recorded(make_session, 60.0, current_a=current_a)) == found


def test_a_small_difference_of_charge_is_left_to_the_watch_of_the_cells(make_session, monkeypatch):
    small, large = Hypothesis("capacity-low", 1.0, 14.0, cell=3), Hypothesis("capacity-low", 1.0, 50.0, cell=4)
    judged(monkeypatch, small, large, Hypothesis("eeprom-worn", 1.0, 8.0))
    found = causes_without_trip(recorded(make_session, 60.0))
    assert [(each.code, each.cell) for each in found] == [("capacity-low", 4), ("eeprom-worn", None)]


def test_nothing_is_said_before_there_is_something_to_look_at(make_session, monkeypatch):
    judged(monkeypatch, Hypothesis("eeprom-worn", 1.0, 8.0))
    trip = {"severity": "trip", "code": "trip-cell-undervoltage", "text": "under", "cell": 3, "at_s": 50.0}
    assert causes_without_trip(recorded(make_session, 10.0)) is None
    assert causes_without_trip(recorded(make_session, 60.0, trip)) is None
    assert causes_without_trip(recorded(make_session, 90.0, trip)) != []
