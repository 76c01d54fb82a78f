import re
import sqlite3
import time
from dataclasses import replace

import pytest

from app.clock import Clock
from app.errors import NotNow
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.sessions.catalogue import Catalogue
from app.sessions.errors import RecordingFailed
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.auto_recorder import GONE_S, AutoRecorder
from app.sessions.recording.disk import DiskLimits
from app.sessions.recording.session_writer import SessionWriter
from app.sources.items import CanItem, LinkChange
from app.sources.master.source import MasterSource
from app.telemetry import Event
from app.words import Message, render
from firmware_protocol.framing import decode_chunk
from tests.fake_clock import FakeClock

CELL = load_cell("samsung-25r-10p")


@pytest.fixture
def pipeline():
    return Pipeline(MasterSource("serial"), lambda: make_estimator("coulomb", CELL, 96), filter_name="c", cell_name="c")


@pytest.fixture
def events():
    return []


@pytest.fixture
def make(tmp_path, events):
    made = []

    def make(*, automatic=True, folder=None, clock=None, **more):
        recorder = AutoRecorder(
            folder or tmp_path / "sessions", automatic=automatic, on_event=events.append, clock=clock or Clock(), **more
        )
        made.append(recorder)
        return recorder

    yield make
    for recorder in made:
        recorder.close()


def play(recorder, pipeline, master, n):
    for _ in range(n):
        item = master.frame()
        recorder.on_item(item)
        recorder.on_output(pipeline.feed(item))


def codes(events):
    return [event.code for event in events]


def test_it_starts_with_the_first_good_frame_and_not_with_noise(make, master, events):
    recorder = make()
    recorder.on_item(LinkChange(1, 1, "rs232", "open"))
    recorder.on_item(replace(master.frame(), frame=decode_chunk(b"noise")))
    assert recorder.session is None
    recorder.on_item(master.frame())
    assert recorder.session is not None
    assert codes(events) == ["recording-started"]


def test_it_starts_with_can_but_not_with_what_the_service_sends(make):
    recorder = make()
    recorder.on_item(CanItem(1, 1, 0x100, bytes(8), sent=True))
    assert recorder.session is None
    recorder.on_item(CanItem(2, 2, 0x100, bytes(8)))
    assert recorder.session is not None


def test_it_ends_when_the_master_is_gone_and_begins_anew_when_it_is_back(make, pipeline, master, events):
    recorder = make()
    play(recorder, pipeline, master, 3)
    first = recorder.session.id
    gone_ns = master.t_ns + int((GONE_S + 1) * 1e9)
    recorder.on_output(pipeline.tick(gone_ns, gone_ns))
    assert recorder.session is None
    master.advance(120_000)
    play(recorder, pipeline, master, 1)
    assert recorder.session.id != first
    assert codes(events) == ["recording-started", "recording-stopped", "recording-started"]


def test_stopped_by_hand_it_stays_stopped_until_the_master_was_gone(make, pipeline, master):
    recorder = make()
    play(recorder, pipeline, master, 2)
    recorder.stop()
    play(recorder, pipeline, master, 5)
    assert recorder.session is None
    gone_ns = master.t_ns + int((GONE_S + 1) * 1e9)
    recorder.on_output(pipeline.tick(gone_ns, gone_ns))
    master.advance(120_000)
    play(recorder, pipeline, master, 1)
    assert recorder.session is not None


def test_by_hand_only_where_it_is_told_so(make, pipeline, master):
    recorder = make(automatic=False)
    play(recorder, pipeline, master, 3)
    assert recorder.session is None
    recorder.start("mine")
    assert recorder.session.name == "mine"
    with pytest.raises(NotNow):
        recorder.start()


def test_frames_estimates_configurations_and_markers_are_in_the_file(make, pipeline, master, tmp_path):
    recorder = make()
    recorder.on_item(master.config())
    pipeline.feed(master.config())
    play(recorder, pipeline, master, 10)
    master.set("conf.ts", [50])
    pipeline.feed(master.config())
    play(recorder, pipeline, master, 1)
    recorder.marker("driver change", "note", "anna")
    session_id = recorder.session.id
    recorder.close()
    with Catalogue(tmp_path / "sessions").open(session_id) as file:
        assert file.info.frames == 12
        assert [config.why for config in file.configs()] == ["in force at the start", "changed"]
        assert [marker.text for marker in file.markers()] == ["driver change"]
        assert file.series(["estimate.soc[36]"], None, None, 100)["estimate.soc[36]"].minimum[0] is not None


def test_a_folder_that_takes_nothing_is_told_once_and_tried_again(make, pipeline, master, events, tmp_path):
    folder = tmp_path / "sessions"
    recorder = make(folder=folder)
    folder.rmdir()
    folder.write_text("in the way")
    play(recorder, pipeline, master, 30)
    assert recorder.session is None
    assert codes(events) == ["recording-failed"]
    assert recorder.start_failure == events[0].message
    folder.unlink()
    master.advance(10_000)
    play(recorder, pipeline, master, 1)
    assert recorder.session is not None
    assert recorder.start_failure is None


def test_what_cannot_be_started_is_a_stall_since_the_first_try(make, pipeline, master, tmp_path):
    folder = tmp_path / "sessions"
    clock = FakeClock()
    recorder = make(folder=folder, clock=clock)
    assert recorder.stall is None
    folder.rmdir()
    folder.write_text("in the way")
    since_ns = clock.wall_ns()
    for _ in range(3):
        play(recorder, pipeline, master, 1)
        master.advance(10_000)
        clock.advance(10)
    assert (recorder.stall.since_ns, recorder.stall.reason) == (since_ns, recorder.start_failure)
    folder.unlink()
    play(recorder, pipeline, master, 1)
    assert recorder.stall is None


def test_a_full_disk_is_a_stall_and_an_event_once_although_its_numbers_change(
    make, pipeline, master, events, monkeypatch
):
    recorder = make()
    play(recorder, pipeline, master, 3)
    recorder.flush()
    began_ns = time.time_ns()
    with monkeypatch.context() as full:
        full.setattr(SessionWriter, "write", Refusal())
        for _ in range(5):
            play(recorder, pipeline, master, 1)
            with pytest.raises(RecordingFailed):
                recorder.flush()
            recorder._status = None  # at most half a second old
        assert "disk is full" in render(recorder.stall.reason)
        assert abs(recorder.stall.since_ns - began_ns) < 2e9
    recorder.flush()
    recorder._status = None
    play(recorder, pipeline, master, 1)
    assert recorder.stall is None
    assert codes(events) == ["recording-started", "recording-trouble", "recording-resumed"]


class Refusal:
    """Of a disk, with another text each time."""

    def __init__(self):
        self.times = 0

    def __call__(self, items):
        self.times += 1
        raise sqlite3.OperationalError(f"database or disk is full ({self.times})")


def test_a_wall_clock_that_is_set_does_not_end_a_session(make, pipeline, master, tmp_path):
    recorder = make()
    play(recorder, pipeline, master, 3)
    session = recorder.session.id
    for jump_s in (-86_400, 86_400):
        for _ in range(5):
            item = master.frame()
            item = replace(item, t_wall_ns=item.t_wall_ns + jump_s * 10**9)
            recorder.on_item(item)
            recorder.on_output(pipeline.feed(item))
    assert recorder.session.id == session
    recorder.close()
    with Catalogue(tmp_path / "sessions").open(session) as file:
        assert file.info.frames == 13
        assert file.info.duration_s < 60


def test_a_session_is_named_by_event_and_time_and_knows_what_the_page_was_told(make, master, tmp_path):
    recorder = make(event="FSG endurance")
    recorder.set_plan(replace(recorder.plan, driver="Anna", vehicle="eR26"))
    recorder.on_item(master.frame())
    session = recorder.session
    assert re.fullmatch(r"FSG endurance 20\d\d-\d\d-\d\d \d\d:\d\d \S+", session.name)
    assert session.metadata == {"event": "FSG endurance", "driver": "Anna", "vehicle": "eR26"}
    assert make(folder=tmp_path / "sessions").plan.driver == "Anna"


def test_split_by_hand_loses_no_frame_and_tells_of_it(make, pipeline, master, events, tmp_path):
    recorder = make()
    play(recorder, pipeline, master, 5)
    first = recorder.session
    second = recorder.split()
    play(recorder, pipeline, master, 5)
    recorder.close()
    assert (second.name, second.metadata["continues"]) == (f"{first.name}, part 2", first.id)
    assert codes(events) == ["recording-started", "recording-split"]
    assert [info.frames for info in Catalogue(tmp_path / "sessions").list()] == [5, 5]


def test_a_session_that_grows_too_long_goes_on_in_a_new_file(make, pipeline, master, events, tmp_path):
    recorder = make(limits=DiskLimits(session_bytes=200_000))
    while "recording-split" not in codes(events):
        play(recorder, pipeline, master, 50)
        recorder.flush()
    play(recorder, pipeline, master, 20)
    recorder.close()
    found = Catalogue(tmp_path / "sessions").list()
    assert 1 <= codes(events).count("recording-split") < len(found)
    assert sum(info.frames for info in found) * 100 == master.uptime_ms - 1000
    assert {info.metadata.get("continues") for info in found} - {None} <= {info.id for info in found}
    assert all(info.is_closed for info in found)


def test_a_marker_is_set_where_the_key_was_pressed(make, master, tmp_path):
    recorder = make(clock=FakeClock())
    recorder.on_item(master.frame())
    session_id = recorder.session.id
    recorder.marker("cone", "off track", "anna", ago_s=12.0)
    recorder.marker("now", "note", "anna")
    recorder.close()
    with Catalogue(tmp_path / "sessions").open(session_id) as file:
        first, second = file.markers()
    assert second.t_mono_ns - first.t_mono_ns == 12 * 10**9


def test_an_event_is_recorded_at_its_own_time_however_late_it_comes(make, master, tmp_path):
    clock = FakeClock()
    recorder = make(clock=clock)
    recorder.on_item(master.frame())
    begun_ns = clock.monotonic_ns()
    happened_ns = clock.wall_ns()
    clock.advance(1.5)  # a busy machine
    recorder.on_event(Event(happened_ns, "trip", "cell-undervoltage", Message("trip")))
    recorder.on_event(Event(happened_ns - 3600 * 10**9, "info", "boot", Message("trip")))  # the clock was set
    info = recorder.stop()
    recorder.close()
    with SessionFile(info.path) as session:
        times = {event["code"]: event["t_mono_ns"] - begun_ns for event in session.events()}
    assert (times["cell-undervoltage"], times["boot"]) == (0, 1_500_000_000)


def test_a_session_that_nothing_came_into_leaves_no_file(make, master, pipeline, tmp_path):
    recorder = make()
    play(recorder, pipeline, master, 20)
    recorder.split()
    recorder.stop()
    recorder.flush()
    (kept,) = Catalogue(tmp_path / "sessions").survey()[0]
    assert kept.frames == 20
    assert [path.name for path in (tmp_path / "sessions").glob("*.sqlite*")] == [kept.path.name]


def test_a_session_in_which_somebody_marked_something_stays(make, tmp_path):
    recorder = make(automatic=False)
    recorder.start()
    recorder.marker("here", "note", "kari")
    recorder.stop()
    recorder.flush()
    assert len(Catalogue(tmp_path / "sessions").survey()[0]) == 1


def test_a_session_keeps_whose_it_is(make):
    recorder = make(source="serial", car="e-26")
    assert recorder.start().metadata.items() >= {"source": "serial", "car": "e-26"}.items()
    assert recorder.split().metadata["car"] == "e-26"
