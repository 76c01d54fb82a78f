import json
import logging
import sqlite3
import threading
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from app.clock import Clock
from app.errors import NotNow
from app.sessions.errors import RecordingFailed, SessionError
from app.sessions.info import RecorderState
from app.sessions.reading.reader import SessionFile
from app.sessions.recording import commit_queue as module
from app.sessions.recording import session_writer
from app.sessions.recording.disk import DiskLimits
from app.sessions.recording.recorder import Recorder
from app.telemetry import Event
from app.words import Message, message_from_json, render
from tests.fake_clock import FunctionClock

MONO_NS = 5_000 * 10**9
WALL_NS = 1_790_000_000 * 10**9


def test_frames_are_in_the_file_exactly_and_in_order(recorder: Recorder, stream) -> None:
    info = recorder.start("friday")
    sent = stream.feed(recorder, 20)
    recorder.frame(MONO_NS + 10**10, WALL_NS + 10**10, 1, b"\x05noise", False)
    recorder.flush()
    rows = sqlite3.connect(info.path).execute("SELECT raw, link, ok FROM frames ORDER BY id").fetchall()
    assert rows == [(raw, 0, 1) for raw in sent] + [(b"\x05noise", 1, 0)]


def test_what_comes_without_a_session_is_not_recorded(recorder: Recorder, stream) -> None:
    stream.feed(recorder, 3)
    info = recorder.start()
    recorder.stop()
    stream.feed(recorder, 3)
    recorder.flush()
    with SessionFile(info.path) as session:
        assert session.info.frames == 0
        assert session.info.is_closed


def test_who_waits_for_a_commit_goes_on_when_it_is_done(recorder: Recorder) -> None:
    recorder.start()
    recorder.flush()
    began_s = time.monotonic()
    recorder.wait_for_commit(60.0)  # nothing waits
    recorder.frame(MONO_NS - 10**9, WALL_NS - 10**9, 0, b"\x05old", True)
    while recorder.status.queued_items:
        recorder.wait_for_commit(60.0)
    assert time.monotonic() - began_s < 50.0


def test_a_second_start_is_refused_and_changes_nothing(recorder: Recorder) -> None:
    first = recorder.start()
    with pytest.raises(NotNow, match=first.id):
        recorder.start()
    assert recorder.status.session is not None
    assert recorder.status.session.id == first.id


def test_sessions_of_one_second_have_names_of_their_own_in_order(recorder: Recorder) -> None:
    ids = []
    for _ in range(3):
        ids.append(recorder.start().id)
        recorder.stop()
    assert ids == ["20260921T141320Z", "20260921T141320Z-2", "20260921T141320Z-3"]
    assert sorted(ids) == ids


def test_status_counts_what_was_handed_over(recorder: Recorder, stream) -> None:
    recorder.start()
    stream.feed(recorder, 7)
    recorder.can_frame(MONO_NS, WALL_NS, 0x100, b"12345678")
    recorder.marker(MONO_NS, WALL_NS, "driver change", kind="driver")
    session = recorder.status.session
    assert session is not None
    assert (session.frames, session.can_frames, session.markers) == (7, 1, 1)
    recorder.flush()
    assert (recorder.status.queued_items, recorder.status.queued_bytes) == (0, 0)
    assert recorder.status.state is RecorderState.RECORDING
    recorder.stop()
    assert recorder.status.state is RecorderState.IDLE


def test_every_kind_of_item_comes_back(recorder: Recorder) -> None:
    info = recorder.start("name", {"event": "endurance", "driver": 2})
    told = Message("verbatim", text="too low")
    recorder.event(MONO_NS, Event(WALL_NS, "trip", "v_min", told, cell=36, value=2.4, limit=2.5, unit="V"))
    recorder.marker(MONO_NS + 1, WALL_NS + 1, "off track", who="anna")
    recorder.config(MONO_NS + 2, WALL_NS + 2, bytes(420), "written")
    recorder.can_frame(MONO_NS + 3, WALL_NS + 3, 0x98FF50E5, b"\1\2")
    recorder.stop()
    recorder.flush()
    with SessionFile(info.path) as session:
        assert session.info.metadata == {"event": "endurance", "driver": 2}
        assert session.info.voltwall == "1.2.3"
        (event,) = session.events()
        assert (event["code"], event["text"], event["cell"], event["limit_value"]) == ("v_min", "too low", 36, 2.5)
        assert message_from_json(json.loads(event["message"])) == told
        (marker,) = session.markers()
        assert (marker.text, marker.who, marker.t_mono_ns) == ("off track", "anna", MONO_NS + 1)
        (config,) = session.configs()
        assert (config.why, config.image) == ("written", bytes(420))
        (can,) = session.can_frames()
        assert (can.can_id, can.data) == (0x98FF50E5, b"\1\2")


def test_estimates_of_a_wrong_shape_are_refused(recorder: Recorder) -> None:
    recorder.start()
    with pytest.raises(SessionError, match="shape"):
        recorder.estimates(MONO_NS, 0, np.zeros(95), np.zeros(95))


def test_a_folder_that_cannot_be_made_is_said_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    recorder = Recorder(tmp_path / "file", Clock(), version="0")
    with pytest.raises(RecordingFailed):
        recorder.start()
    assert recorder.status.session is None
    recorder.close()


class Disk:
    """Free space that a test sets."""

    def __init__(self) -> None:
        self.free = 1 << 40

    def __call__(self, _: Path) -> int:
        return self.free


def make_recorder(tmp_path: Path, disk: Disk, queue_bytes: int = 1 << 20) -> Recorder:
    limits = DiskLimits(warn_free_bytes=1 << 30, stop_free_bytes=1 << 26, queue_bytes=queue_bytes)
    return Recorder(
        tmp_path, FunctionClock(lambda: MONO_NS, lambda: WALL_NS), version="0", limits=limits, free_bytes=disk
    )


def test_little_space_is_warned_of_while_recording_goes_on(tmp_path: Path, stream) -> None:
    disk = Disk()
    recorder = make_recorder(tmp_path, disk)
    recorder.start()
    recorder.flush()
    assert recorder.status.warning is None
    disk.free = 500 << 20
    stream.feed(recorder, 1)
    recorder.flush()
    assert recorder.status.warning is not None
    assert "500 MB" in render(recorder.status.warning)
    assert recorder.status.state is RecorderState.RECORDING
    recorder.close()


def test_a_full_disk_stalls_and_recording_resumes_without_loss(tmp_path: Path, stream, caplog) -> None:
    disk = Disk()
    recorder = make_recorder(tmp_path, disk)
    info = recorder.start()
    sent = stream.feed(recorder, 5)
    recorder.flush()
    disk.free = 1 << 20
    sent += stream.feed(recorder, 5)
    with caplog.at_level(logging.WARNING), pytest.raises(RecordingFailed, match="disk nearly full"):
        recorder.flush()
    assert recorder.status.state is RecorderState.STALLED
    assert recorder.status.queued_items == 10
    assert "stalled" in caplog.text
    disk.free = 1 << 40
    sent += stream.feed(recorder, 5)
    recorder.flush()
    assert recorder.status.state is RecorderState.RECORDING
    recorder.close()
    with SessionFile(info.path) as session:
        assert [frame.raw for frame in session.frames()] == sent
        assert session.info.is_closed
        assert session.events() == []


def test_what_a_full_queue_loses_is_counted_and_written_down(tmp_path: Path, stream) -> None:
    disk = Disk()
    recorder = make_recorder(tmp_path, disk, queue_bytes=20_000)
    info = recorder.start()
    recorder.flush()
    disk.free = 0
    stream.feed(recorder, 100)
    with pytest.raises(RecordingFailed):
        recorder.flush()
    lost = recorder.status.lost_items
    assert 100 < lost < 200
    disk.free = 1 << 40
    recorder.flush()
    recorder.close()
    with SessionFile(info.path) as session:
        (event,) = session.events()
        assert (event["code"], event["value"]) == ("recorder_lost", lost)


def test_a_split_loses_nothing_and_tells_where_it_goes_on(recorder: Recorder, stream) -> None:
    first = recorder.start("long", {"driver": 1})
    recorder.config(MONO_NS, WALL_NS, bytes(420), "read")
    sent = stream.feed(recorder, 5)
    second = recorder.split()
    sent += stream.feed(recorder, 5)
    recorder.flush()
    with SessionFile(first.path) as session, SessionFile(second.path) as following:
        assert session.info.is_closed
        assert [frame.raw for file in (session, following) for frame in file.frames()] == sent
        assert following.info.name == "long"
        assert following.info.metadata == {"driver": 1, "continues": first.id}
        assert [config.image for config in following.configs()] == [bytes(420)]


def test_a_long_session_is_split_by_itself(tmp_path: Path, stream) -> None:
    limits = DiskLimits(stop_free_bytes=0, session_bytes=200_000)
    recorder = Recorder(tmp_path, FunctionClock(lambda: MONO_NS, lambda: WALL_NS), version="0", limits=limits)
    recorder.start()
    sent = []
    for _ in range(30):
        sent += stream.feed(recorder, 30)
        recorder.flush()
    recorder.close()
    paths = sorted(tmp_path.glob("*.sqlite"), key=lambda path: (len(path.stem), path.stem))
    assert len(paths) > 2
    found = []
    for path in paths:
        with SessionFile(path) as session:
            assert session.info.is_closed
            found += [frame.raw for frame in session.frames()]
    assert found == sent


def test_nothing_to_split_is_said(recorder: Recorder) -> None:
    with pytest.raises(NotNow):
        recorder.split()


def test_a_closed_session_has_no_unused_pages(recorder: Recorder, stream) -> None:
    info = recorder.start()
    stream.feed(recorder, 700)
    recorder.flush()
    stream.feed(recorder, 10)
    recorder.close()
    with closing(sqlite3.connect(info.path)) as connection:
        assert connection.execute("SELECT count(*) FROM chunks").fetchone()[0] == 2
        assert connection.execute("PRAGMA freelist_count").fetchone()[0] == 0


def test_frames_are_committed_while_a_chunk_is_packed(recorder: Recorder, stream, monkeypatch) -> None:
    monkeypatch.setattr(session_writer, "CHUNK_NS", 10**9)
    monkeypatch.setattr(module, "COMMIT_S", 0.0)
    committed: list[int] = []
    pack = session_writer.pack_block

    def slow(values):
        """On a machine that does much else: another frame comes, and is on the disk before the chunk is."""
        if len(committed) < 3:
            stream.feed(recorder, 1)
            with closing(sqlite3.connect(info.path)) as connection:
                committed.append(connection.execute("SELECT count(*) FROM frames").fetchone()[0])
                assert connection.execute("SELECT count(*) FROM chunks").fetchone() == (0,)
        return pack(values)

    info = recorder.start()
    recorder.flush()
    monkeypatch.setattr(session_writer, "pack_block", slow)
    stream.feed(recorder, 20)
    recorder.flush()
    recorder.stop()
    recorder.flush()
    assert len(set(committed)) > 1
    with SessionFile(info.path) as session:
        assert session.problems() == []
        assert session.info.frames == 23


def test_a_disk_that_hangs_is_told_and_so_is_its_return(recorder: Recorder, stream, monkeypatch) -> None:
    hanging, go_on = threading.Event(), threading.Event()

    def write(self, items):
        hanging.set()
        assert go_on.wait(30)
        return real_write(self, items)

    real_write = session_writer.SessionWriter.write
    monkeypatch.setattr(session_writer.SessionWriter, "write", write)
    recorder.start()
    stream.feed(recorder, 3)
    assert hanging.wait(30)
    assert recorder.status.error is None, "not long enough to be told"
    monkeypatch.setattr(module, "STUCK_S", 0.0)
    status = recorder.status
    assert (status.state, status.error.code) == (RecorderState.STALLED, "disk-silent")
    go_on.set()
    recorder.flush(30)
    assert recorder.status.error is None
