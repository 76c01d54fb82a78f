"""What the judge had found while a session was recorded may explain a trip."""

from types import SimpleNamespace

from app.analysis.incidents import Trigger
from app.analysis.root_cause.from_session import found_live
from app.analysis.root_cause.judge import judge
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
