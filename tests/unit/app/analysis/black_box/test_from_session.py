"""Black boxes live and out of the file are one and the same."""

import math
import queue
import threading
from dataclasses import asdict, replace

import pytest

from app.analysis.black_box import recorder
from app.analysis.black_box.from_session import black_boxes, explained, keep_black_boxes, stored_box
from app.analysis.black_box.recorder import TRIES, BlackBoxRecorder
from app.analysis.root_cause.from_session import verdict_of
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Output, Pipeline
from app.sessions.black_box_store import BlackBoxStore, StoredBox
from app.sessions.errors import RecordingFailed
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sources.master.source import MasterSource
from app.telemetry import Event
from app.words import Message, Quantity, condition
from firmware_protocol.memory_map import V_MISSING
from tests.fake_clock import FunctionClock

CELL = load_cell("samsung-25r-10p")


class Car:
    """A pipeline with a recorder and a black box, fed by a made-up master."""

    def __init__(self, master, folder):
        self.master = master
        self.pipeline = Pipeline(
            MasterSource("serial"), lambda: make_estimator("coulomb", CELL, 96), filter_name="c", cell_name="c"
        )
        self.recorder = Recorder(folder / "sessions", FunctionClock(lambda: master.t_ns), version="0")
        self.info = self.recorder.start()
        self.made = []
        self.boxes = BlackBoxRecorder(folder / "boxes.sqlite", lambda: self.info.id, self.made.append, self.explain)
        self.take(master.config())

    def explain(self, session_id, group):
        self.recorder.flush()
        with SessionFile(self.info.path) as session:
            return verdict_of(session, group)

    def take(self, item):
        self.recorder.frame(item.t_mono_ns, item.t_wall_ns, 0, item.frame.raw, True)
        output = self.pipeline.feed(item)
        for event in output.events:
            self.recorder.event(item.t_mono_ns, event)
        if output.estimates is not None:
            self.recorder.estimates(item.t_mono_ns, output.uptime_ms, output.estimates.soc, output.estimates.soc_sigma)
        if output.snapshot is not None and output.snapshot.config is not None and not self.info.metadata:
            self.recorder.config(item.t_mono_ns, item.t_wall_ns, output.snapshot.config, "in force")
        self.boxes.on_output(output, item.t_mono_ns)

    def run(self, seconds):
        for _ in range(round(seconds * 10)):
            self.take(self.master.frame())
            if self.master.uptime_ms % 5000 == 0:
                self.take(self.master.config())

    def set_cell(self, volts, cell=30):
        values = [37000] * 96
        values[cell] = round(volts * 1e4)
        self.master.set("v", values)


def same(one, other):
    """Equal but for the last digit of counts that were stored."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-4)
    return one == other


@pytest.fixture
def car(master, tmp_path):
    car = Car(master, tmp_path)
    yield car
    car.boxes.close()
    car.recorder.close()


def test_a_trip_is_boxed_live_and_again_out_of_the_file(car, tmp_path):
    car.run(15)
    car.set_cell(2.3)
    car.run(1)
    car.set_cell(3.6)
    assert car.made == []
    car.run(9)
    car.boxes.close()
    car.recorder.close()
    (live,) = car.made
    assert live.is_complete
    assert (live.code, live.cell) == ("cell-undervoltage", 30)
    assert live.beyond.since_s == pytest.approx(-0.3, abs=0.05)
    assert live.beyond.lasted_s == pytest.approx(1.0, abs=0.05)
    with SessionFile(car.info.path) as session:
        (recorded,) = black_boxes(session)
        assert same(asdict(recorded), asdict(live))
        store = BlackBoxStore(tmp_path / "boxes.sqlite")
        assert [box.id for box in keep_black_boxes(session, store)] == [live.id]
        assert [box.message for box in store.stored()] == [live.message]
        assert stored_box(store, live.id) == live  # what is complete is not written again
        store.close()


def test_a_warning_by_the_verdict_on_a_trip_makes_no_second_box(car):
    car.run(15)
    car.set_cell(2.3)
    car.run(1)
    car.set_cell(3.6)
    car.run(9)
    car.boxes.wait()
    warning = Event(car.master.t_ns, "warning", "joint-resistance-high", condition("joint-resistance-high"), cell=30)
    car.boxes.on_output(Output(None, (warning,)), car.master.t_ns)
    car.run(9)
    car.boxes.close()
    car.recorder.close()
    assert [box.code for box in car.made] == ["cell-undervoltage"]


def test_a_loose_wire_that_reads_high_first_is_named_in_the_box(car):
    car.run(15)
    car.set_cell(4.9)
    car.run(0.5)
    values = [37000] * 96
    values[30] = values[31] = V_MISSING
    car.master.set("v", values)
    car.run(9)
    car.boxes.close()
    (box,) = car.made
    assert (box.code, box.cause.code, box.cause.cell) == ("cell-overvoltage", "sense-wire-open", 30)
    assert "pack 3, cell 7, pack 3, cell 8" in box.cause.evidence[0].text


def test_a_box_is_kept_when_the_search_for_its_cause_fails(car, monkeypatch):
    monkeypatch.setattr(car.boxes, "_explain", lambda session_id, group: {}["a fault of ours"])
    car.run(15)
    car.set_cell(2.3)
    car.run(8)
    car.boxes.close()
    assert [(box.code, box.cause) for box in car.made] == [("cell-undervoltage", None)]


def refusing(code, searches):
    """A search that meets a recording of which the end is not on the disk."""

    def search(session_id, group):
        searches.append(group[0].code)
        raise RecordingFailed(Message(code, time=Quantity(5.0, "s")))

    return search


def test_the_cause_is_looked_for_again_where_the_disk_was_busy(car, monkeypatch):
    made, searches, search = queue.SimpleQueue(), [], car.explain
    busy = refusing("not-written-within", searches)
    monkeypatch.setattr(car.boxes, "_explain", lambda *of: (busy if len(searches) < 3 else search)(*of))
    monkeypatch.setattr(car.boxes, "_on_made", made.put)
    car.run(15)
    car.set_cell(2.3)
    car.run(8)
    box = made.get(timeout=30)
    assert len(searches) == 3
    assert box.cause is not None
    car.boxes.close()


@pytest.mark.parametrize(("code", "tries"), [("not-written-within", TRIES), ("disk-silent", 1)])
def test_a_disk_that_stays_away_costs_the_cause_and_not_the_box(car, monkeypatch, code, tries):
    made, searches = queue.SimpleQueue(), []
    monkeypatch.setattr(car.boxes, "_explain", refusing(code, searches))
    monkeypatch.setattr(car.boxes, "_on_made", made.put)
    car.run(15)
    car.set_cell(2.3)
    car.run(8)
    box = made.get(timeout=30)
    assert (box.code, box.cause, len(searches)) == ("cell-undervoltage", None, tries)
    car.boxes.close()


def test_what_ends_before_its_seconds_are_over_is_kept_and_completed_later(car, tmp_path):
    car.run(15)
    car.set_cell(2.3)
    car.run(1)
    car.boxes.close()
    assert [box.is_complete for box in car.made] == [False]
    car.boxes = BlackBoxRecorder(tmp_path / "other.sqlite", lambda: None, lambda box: None)
    car.run(8)
    car.recorder.close()
    store = BlackBoxStore(tmp_path / "boxes.sqlite")
    with SessionFile(car.info.path) as session:
        assert [box.is_complete for box in keep_black_boxes(session, store)] == [True]
    store.close()


def test_a_box_of_an_earlier_version_gets_its_findings_when_it_is_read(car, tmp_path):
    car.run(12)
    car.set_cell(2.3)
    car.run(8)
    car.boxes.close()
    (box,) = car.made
    body = asdict(box)
    message = body.pop("message")
    del body["findings"]
    body |= {"text": message["text"], "text_words": message, "summary": ["A trip."]}
    body["events"] = [each | {"text": each["message"]["text"], "text_words": None} for each in body["events"]]
    for each in body["events"]:
        del each["message"]
    cause = body["cause"]
    cause |= {"message": cause["message"]["text"], "message_words": cause["message"]}
    store = BlackBoxStore(tmp_path / "old.sqlite")
    store.add(StoredBox(box.id, box.at, None, box.code, box.severity, box.cell, box.message, True), body)
    read = stored_box(store, box.id)
    assert (read.message, read.findings, read.cause) == (box.message, box.findings, box.cause)
    assert [each.message.text for each in read.events] == [each.message.text for each in box.events]
    assert {each.message.code for each in read.events} == {"verbatim"}
    assert stored_box(store, "none") is None
    assert [each.message for each in store.stored()] == [box.message]
    store.close()


def test_a_box_of_before_there_were_causes_is_explained_by_its_session(car, tmp_path):
    car.run(15)
    car.set_cell(2.3)
    car.run(8)
    car.boxes.close()
    car.recorder.close()
    (live,) = car.made
    findings = [each for each in live.findings if each.code != "box-no-cause"]
    old = replace(live, cause=None, findings=findings)
    with SessionFile(car.info.path) as session:
        assert same(asdict(explained(session, old)), asdict(live))
        assert explained(session, live).findings == live.findings  # "nothing explains it" stands once
        elsewhere = replace(old, at=old.at + 100.0)
        assert explained(session, elsewhere) == elsewhere


def test_a_box_of_nothing_but_an_event_says_what_is_missing(make_session):
    path = make_session(
        [], [], events=[{"at_s": 3.0, "severity": "trip", "code": "trip-slave-lost", "text": "a slave"}]
    )
    with SessionFile(path) as session:
        (box,) = black_boxes(session)
    assert not box.is_complete
    assert [found.code for found in box.findings] == ["box-event", "box-no-cell", "box-partial", "box-no-cause"]
    assert box.cells.voltage_at_v == [None] * 96


def test_what_is_not_written_in_time_at_the_end_is_left_to_its_session(master, tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "CLOSE_S", 0.05)
    car, begun, released = Car(master, tmp_path), threading.Event(), threading.Event()

    def explain(session_id, group):
        begun.set()
        released.wait(30)

    car.boxes = BlackBoxRecorder(tmp_path / "boxes.sqlite", lambda: car.info.id, car.made.append, explain)
    for _ in range(3):
        car.set_cell(2.3)
        car.run(1)
        car.set_cell(3.6)
        car.run(9)
    assert begun.wait(30)
    car.recorder.close()
    closing = threading.Thread(target=car.boxes.close)
    closing.start()
    while not car.boxes._is_late:
        closing.join(0.01)
    released.set()
    closing.join(30)
    assert len(car.made) == 1
    store = BlackBoxStore(tmp_path / "boxes.sqlite")
    with SessionFile(car.info.path) as session:
        assert len(keep_black_boxes(session, store)) == 3
    store.close()


def test_a_box_that_nothing_explained_is_looked_at_again_and_revised(master, tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "LATER_S", 3.0)
    car, asked = Car(master, tmp_path), []

    def explain(session_id, group):
        asked.append(session_id)
        cause = car.explain(session_id, group)
        if len(asked) == 1:
            return replace(cause, code="unknown", cell=None, pack=None)
        return replace(cause, code="joint-resistance-high", cell=30, pack=2, revised=True)

    car.boxes = BlackBoxRecorder(tmp_path / "again.sqlite", lambda: car.info.id, car.made.append, explain)
    car.run(5)
    car.set_cell(2.3)
    car.run(1)
    car.set_cell(3.6)
    car.run(7)
    car.boxes.wait()
    assert [box.cause.code for box in car.made] == ["unknown"]
    car.run(20)
    car.boxes.wait()
    assert [box.cause.code for box in car.made] == ["unknown", "joint-resistance-high"]
    assert len(asked) == 2  # what has a cause is asked about no more
    (kept,) = car.boxes.store.stored()
    assert stored_box(car.boxes.store, kept.id) == car.made[1]
    assert "box-no-cause" not in [found.code for found in car.made[1].findings]
    car.boxes.close()
    car.recorder.close()


def test_a_cause_that_could_not_be_looked_for_is_looked_for_again(master, tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "LATER_S", 3.0)
    car, asked = Car(master, tmp_path), []

    def explain(session_id, group):
        asked.append(session_id)
        if len(asked) == 1:
            raise RecordingFailed(Message("disk-silent", time=Quantity(5.0, "s")))
        return replace(car.explain(session_id, group), code="joint-resistance-high", cell=30, pack=2)

    car.boxes = BlackBoxRecorder(tmp_path / "again.sqlite", lambda: car.info.id, car.made.append, explain)
    car.run(5)
    car.set_cell(2.3)
    car.run(1)
    car.set_cell(3.6)
    car.run(7)
    car.boxes.wait()
    assert [box.cause for box in car.made] == [None]
    car.run(20)
    car.boxes.wait()
    assert [box.cause and box.cause.code for box in car.made] == [None, "joint-resistance-high"]
    car.boxes.close()
    car.recorder.close()
