"""A verdict on a trip is noted and shown when it is made, and again, as another one, when it is revised."""

from dataclasses import replace
from types import SimpleNamespace

from app.analysis.black_box.from_session import black_boxes
from app.service.trip_explanation import TripExplanation
from app.sessions.reading.reader import SessionFile
from tests.fake_clock import FakeClock


def test_a_revised_cause_is_an_event_of_its_own_and_goes_to_the_alarm(make_session):
    trip = {"severity": "trip", "code": "trip-cell-undervoltage", "text": "under", "cell": 3, "at_s": 5.0}
    with SessionFile(make_session([0.0, 10.0], [50.0, 50.0], events=[trip])) as session:
        (box,) = black_boxes(session)
    added, explained = [], []
    pipeline = SimpleNamespace(explain=lambda cause, at_ns: explained.append((cause.revised, at_ns)))
    events = SimpleNamespace(add=added.append)
    explanation = TripExplanation(None, None, pipeline, None, events, FakeClock())
    explanation.on_black_box(box)
    explanation.on_black_box(replace(box, cause=replace(box.cause, revised=True)))
    assert [(event.code, event.message.code) for event in added] == [
        ("blackbox", "black-box-incomplete"),
        ("trip-cause", "trip-cause"),
        ("trip-cause", "trip-cause-revised"),
    ]
    assert explained == [(False, round(box.at * 1e9)), (True, round(box.at * 1e9))]
