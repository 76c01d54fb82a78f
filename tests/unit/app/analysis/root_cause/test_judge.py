"""What explains a trip, what follows from something else, and what is told without a trip."""

from dataclasses import asdict, replace

import pytest

from app.analysis.incidents import Trigger
from app.analysis.root_cause.judge import (
    EXPLAINS,
    FOLLOWS,
    SAME,
    cause_from_json,
    cause_of,
    confidences,
    judge,
    trip_kind,
)
from app.analysis.root_cause.recording import Hypothesis
from app.words import Cell, Message, Pack
from app.words.conditions import CONDITIONS

SEGMENTS = (12,) * 8
JUDGED_S = 1_790_000_100.0


def trip(code="trip-cell-undervoltage", cell=75, at_s=100.0):
    return Trigger(at_s, at_s, code, "trip", Message("cell-undervoltage"), cell, 2.4, 2.5, "V")


def test_the_strongest_suspicion_of_the_tripped_cell_is_its_cause():
    joint = Hypothesis("joint-resistance-high", 60.0, 30.0, (), cell=75)
    capacity = Hypothesis("capacity-low", 0.0, 12.0, (), cell=75)
    elsewhere = Hypothesis("joint-resistance-high", 60.0, 90.0, (), cell=3)
    (of_trip, other) = judge([trip()], [capacity, joint, elsewhere], SEGMENTS)
    assert [each.code for each in of_trip.ranked] == ["joint-resistance-high", "capacity-low"]
    assert (other.trip, other.ranked[0].cell) == (None, 3)
    cause = cause_of(of_trip, SEGMENTS, JUDGED_S)
    assert (cause.code, cause.cell, cause.pack, cause.trip) == (
        "joint-resistance-high",
        75,
        6,
        "trip-cell-undervoltage",
    )
    assert cause.message.text == "High-resistance busbar joint at pack 7, cell 4"
    assert cause_from_json(asdict(cause)) == cause


def test_a_cell_of_another_pack_is_no_cause_of_what_one_cell_did():
    elsewhere = Hypothesis("capacity-low", 0.0, 90.0, (), cell=3)
    told = judge([trip()], [elsewhere], SEGMENTS)
    assert told[0].ranked == ()
    assert cause_of(told[0], SEGMENTS, JUDGED_S).code == "unknown"
    neighbour = Hypothesis("capacity-low", 0.0, 9.0, (), cell=74)
    assert judge([trip()], [elsewhere, neighbour], SEGMENTS)[0].ranked == (replace(neighbour, pack=6),)


def test_what_began_after_a_trip_did_not_cause_it():
    (told,) = judge([trip(at_s=50.0)], [Hypothesis("joint-resistance-high", 60.0, 5.0, (), cell=75)], SEGMENTS)
    assert cause_of(told, SEGMENTS, JUDGED_S).code == "unknown"


def test_a_sensor_does_not_explain_what_it_does_not_measure():
    (told, _) = judge([trip()], [Hypothesis("temperature-sensor-fault", 60.0, 50.0, (), cell=75)], SEGMENTS)
    assert told.ranked == ()


@pytest.mark.parametrize("code", ["cell-overvoltage", "cell-undervoltage", "cell-undertemperature", "trip-sensor-lost"])
def test_a_broken_wire_explains_whichever_limit_its_loose_input_passes_first(code):
    wire = Hypothesis("sense-wire-open", 100.6, 60.0, (), cell=30)
    (told,) = judge([trip(code, cell=31)], [wire], SEGMENTS)
    assert told.ranked == (replace(wire, pack=2),)


def test_a_consequence_is_not_told_beside_its_cause():
    silent, flooded = Hypothesis("charger-silent", 10.0, 40.0), Hypothesis("can-babbling-node", 9.0, 80.0)
    assert [each.ranked[0].code for each in judge([], [silent, flooded], SEGMENTS)] == ["can-babbling-node"]


def test_a_consequence_in_another_pack_is_told():
    lost = Hypothesis("slave-lost", 10.0, 60.0, (), pack=2)
    here, there = (Hypothesis("joint-resistance-high", 0.0, 30.0, (), cell=cell) for cell in (25, 75))
    assert {each.ranked[0].place for each in judge([], [lost, here, there], SEGMENTS)} == {(None, 2), (75, 6)}


@pytest.mark.parametrize(
    ("message", "cell"),
    [
        (Message("slave-lost-in-packs", n=1, packs=(Pack(2),)), None),
        (Message("trip-at", what=Message("slave-lost"), cell=Cell(24)), 24),  # as an earlier version recorded it
    ],
)
def test_a_lost_slave_explains_the_trip_of_its_pack_and_no_other(message, cell):
    tripped = replace(trip("trip-slave-lost", cell), message=message)
    here, there = (Hypothesis("slave-lost", 99.0, 60.0, (), pack=pack) for pack in (2, 4))
    (of_trip, _) = judge([tripped], [there, here], SEGMENTS)
    assert [each.pack for each in of_trip.ranked] == [2]


def test_weak_evidence_without_a_trip_is_no_cause():
    assert judge([], [Hypothesis("self-discharge-high", 0.0, 3.0, (), cell=1)], SEGMENTS) == []


def test_confidences_leave_room_for_none_of_them():
    ranked = (
        Hypothesis("joint-resistance-high", 0.0, 2.0, (), cell=1),
        Hypothesis("cell-resistance-high", 0.0, 2.0, (), cell=1),
    )
    first, second = confidences(ranked)
    assert first == pytest.approx(second)
    assert first + second < 0.9
    assert confidences(()) == ()


def test_what_only_repeats_a_trip_has_no_kind():
    assert trip_kind("master-fault") is None
    assert trip_kind("trip-cell-overtemperature") == trip_kind("cell-overtemperature") == "cell-overtemperature"


def test_every_code_is_a_condition():
    told = {code for codes in (*EXPLAINS.values(), *FOLLOWS.values(), *SAME.values()) for code in codes}
    assert sorted((told | set(EXPLAINS) | set(FOLLOWS) | set(SAME)) - set(CONDITIONS)) == []
