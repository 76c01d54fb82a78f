import pytest

from app.analysis.drill.days import CHOICES
from app.analysis.drill.product import (
    CAUSES,
    MEANS,
    answer_of_cause,
    answer_of_events,
    answer_of_message,
    reports_fault,
)
from app.analysis.drill.score import Answer
from app.analysis.root_cause.codes import NAMES, cause_message
from app.words import Message


@pytest.mark.parametrize(
    ("events", "answer"),
    [
        ([], None),
        ([("cell-voltage-near-low", 3)], None),
        ([("trip-slave-lost", 24)], Answer("lost-slave", 3)),
        ([("trip-sensor-lost", None)], Answer("current-unplugged")),
        ([("trip-sensor-lost", 30)], Answer("open-wire", 3, 7)),
        ([("trip-v-min", 75), ("finding-joint-grown", 75)], Answer("loose-joint", 7, 4)),  # the finding knows more
        ([("boot", None)], Answer("reset")),
    ],
)
def test_events_mean_an_answer(events, answer):
    assert answer_of_events(events) == answer


def test_a_named_cause_means_the_fault_that_makes_it():
    assert answer_of_cause("weak-joint", 75, 6) == Answer("loose-joint", 7, 4)
    assert answer_of_cause("slave-lost", None, 2) == Answer("lost-slave", 3)
    assert answer_of_cause("master-reset", None, None) == Answer("reset")
    assert answer_of_cause("unknown", 4, 0) is None


def test_everything_means_a_fault_that_a_day_may_have():
    assert {*MEANS.values(), *CAUSES.values()} <= set(CHOICES)
    assert set(CAUSES.values()) == set(CHOICES)


def test_what_is_said_in_passing_tells_nothing():
    assert reports_fault("trip", "trip-v-min")
    assert reports_fault("info", "finding-cell-leaks")
    assert not reports_fault("info", "finding-ended")
    assert not reports_fault("info", "config-written")


def test_the_event_of_a_trips_cause_means_the_same():
    told = Message("trip-cause", cause=cause_message("weak-joint", 75, 6))
    assert answer_of_message(told, 75) == Answer("loose-joint", 7, 4)
    told = Message("trip-cause", cause=cause_message("slave-lost", None, 2))
    assert answer_of_message(told, None) == Answer("lost-slave", 3)
    assert answer_of_message(Message("trip-cause", cause=cause_message("unknown", None, None)), None) is None


def test_every_cause_is_one_that_root_cause_analysis_knows():
    assert set(CAUSES) <= set(NAMES)
