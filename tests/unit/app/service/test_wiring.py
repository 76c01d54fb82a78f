"""The parts together, with no link configured: started, fed by hand, stopped in order."""

import threading

import pytest

from app.clock import Clock
from app.errors import ConfigError
from app.service.pipeline_thread import PipelineThread
from app.service.settings import Settings
from app.service.wiring import make_service
from app.sources.items import CanItem


def service(folder, **settings):
    return make_service(
        Settings(data=folder, record=False, filter="coulomb", **settings),
        Clock(),
        source="serial",
        serial_url=None,
        can_url=None,
    )


def test_a_service_starts_and_stops_and_what_was_noted_is_kept(tmp_path):
    first = service(tmp_path)
    first.start()
    first.events.note("info", "recording", "started by hand")
    first.stop()
    second = service(tmp_path)
    try:
        assert [event.code for event in second.events.store.query()] == ["recording"]
    finally:
        second.stop()


def test_events_reach_the_recording(tmp_path):
    made = service(tmp_path)
    try:
        info = made.recorder.start("test")
        made.events.note("warning", "found", "in the recording too")
        made.recorder.flush()
        with made.catalogue.open(info.id) as session:
            assert "found" in [event["code"] for event in session.events()]
        assert made.state.at(0).recording.session_id == info.id
    finally:
        made.stop()


def test_a_setting_that_cannot_be_used_stops_the_start(tmp_path):
    with pytest.raises(ConfigError, match="no-such-cell"):
        service(tmp_path, cell="no-such-cell")


def test_a_full_inbox_at_the_end_is_in_the_recording_and_nobody_fails(tmp_path, caplog):
    made = service(tmp_path)
    info = made.recorder.start("test")
    for number in range(4000):
        made.live._inbox.put(CanItem(number, number, 0x123, bytes(8)))
    made.start()
    made.stop()
    with made.catalogue.open(info.id) as session:
        assert session.info.is_closed
        assert session.info.can_frames == 4000
    assert [record.message for record in caplog.records if record.levelname == "ERROR"] == []


def test_what_is_told_after_the_end_fails_nobody(tmp_path):
    made = service(tmp_path)
    made.stop()
    made.events.note("info", "recording", "too late")


def test_a_stop_does_not_wait_for_what_a_first_start_compiles(tmp_path, monkeypatch):
    compiled, begun = threading.Event(), threading.Event()

    def compile_for_ever(self):
        begun.set()
        compiled.wait(60)

    monkeypatch.setattr(PipelineThread, "warm_up", compile_for_ever)
    made = service(tmp_path)
    made.start()
    assert begun.wait(30)
    stopping = threading.Thread(target=made.stop)
    stopping.start()
    stopping.join(30)
    is_stopped = not stopping.is_alive()
    compiled.set()
    stopping.join()
    assert is_stopped
