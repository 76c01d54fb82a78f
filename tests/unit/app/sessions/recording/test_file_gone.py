"""The file, its log or its folder is taken away while it is written."""

import shutil

import pytest

from app.sessions.reading.reader import SessionFile
from app.words import render
from tests.service_process import until


def delete(path):
    path.unlink()


def delete_log(path):
    path.with_name(path.name + "-wal").unlink()


def delete_folder(path):
    shutil.rmtree(path.parent)


def replace(path):
    other = path.with_name("other")
    other.write_bytes(b"something else")
    other.replace(path)


def move(path):
    path.rename(path.with_name("moved.sqlite"))


@pytest.mark.parametrize("take_away", [delete, delete_log, delete_folder, replace, move])
def test_recording_goes_on_in_a_new_file_and_says_so(recorder, stream, take_away):
    before = recorder.start("friday")
    recorder.config(*stream.next()[:2], bytes(420), "in force at the start")
    stream.feed(recorder, 10)
    recorder.flush()
    take_away(before.path)
    until(lambda: recorder.status.session.id != before.id, 2)
    status = recorder.status
    assert f"the file of {before.id} was deleted or replaced" in render(status.warning)
    assert status.error is None
    sent = stream.feed(recorder, 10)
    recorder.stop()
    recorder.flush()
    with SessionFile(status.session.path) as session:
        assert [frame.raw for frame in session.frames()] == sent
        assert session.info.metadata["continues"] == before.id
        assert len(session.configs()) == 1
        assert session.problems() == []


def test_frames_that_wait_are_in_the_new_file(recorder, stream):
    before = recorder.start()
    recorder.flush()
    before.path.unlink()
    sent = stream.feed(recorder, 10)
    until(lambda: recorder.status.session.id != before.id)
    recorder.flush()
    with SessionFile(recorder.status.session.path) as session:
        assert [frame.raw for frame in session.frames()] == sent
    assert recorder.status.session.frames == 10


def test_who_stops_it_is_told_and_the_next_session_is_recorded(recorder, stream):
    before = recorder.start()
    stream.feed(recorder, 10)
    recorder.flush()
    before.path.unlink()
    recorder.stop()
    recorder.flush()
    assert "it is lost" in render(recorder.file_loss(before.id)) or "goes on as" in render(
        recorder.file_loss(before.id)
    )
    after = recorder.start()
    sent = stream.feed(recorder, 10)
    recorder.stop()
    recorder.flush()
    with SessionFile(after.path) as session:
        assert [frame.raw for frame in session.frames()] == sent
    assert recorder.file_loss(after.id) is None
