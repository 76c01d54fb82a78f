"""The file, its log or its folder is taken away, cut or written over while it is written."""

import os
import shutil
import sqlite3
from contextlib import closing

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


def cut_log(path):
    os.truncate(path.with_name(path.name + "-wal"), 0)


def cut_log_to_half(path):
    log = path.with_name(path.name + "-wal")
    os.truncate(log, log.stat().st_size // 2)


def cut_before_a_write(path):
    """The log is cut between a look and a write, which fills what is missing with zeros."""
    log = path.with_name(path.name + "-wal")
    size = log.stat().st_size
    os.truncate(log, 0)
    os.truncate(log, size)


def cut(path):
    os.truncate(path, 0)


def cut_to_half(path):
    os.truncate(path, path.stat().st_size // 2)


def write_over(path):
    """Other bytes of the same length."""
    with path.open("r+b") as file:
        file.write(os.urandom(path.stat().st_size))


def put_another_session_over(path):
    """As `cp other.sqlite session.sqlite` does, of more bytes than before."""
    whole = path.with_name("whole")
    with closing(sqlite3.connect(path)) as here, closing(sqlite3.connect(whole)) as there:
        here.backup(there)
        there.execute("UPDATE meta SET value = 'another' WHERE key = 'id'")
        there.commit()
    with path.open("r+b") as file:
        file.write(whole.read_bytes() + bytes(1 << 20))


def bring_into_the_file(path):
    """The log goes into the file, as it does every few minutes."""
    with closing(sqlite3.connect(path)) as other:
        assert other.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()[1] > 0


TAKEN_AWAY = [delete, delete_log, delete_folder, replace, move]
SPOILT = [cut, cut_to_half, cut_log, cut_log_to_half, cut_before_a_write, write_over, put_another_session_over]


@pytest.mark.parametrize("take_away", TAKEN_AWAY + SPOILT)
def test_recording_goes_on_in_a_new_file_and_says_so(recorder, stream, take_away):
    before = recorder.start("friday")
    recorder.config(*stream.next()[:2], bytes(420), "in force at the start")
    stream.feed(recorder, 10)
    recorder.flush()
    bring_into_the_file(before.path)
    stream.feed(recorder, 5)
    recorder.flush()
    take_away(before.path)
    until(lambda: recorder.status.session.id != before.id, 2)
    status = recorder.status
    assert f"the file of {before.id} was deleted, replaced or damaged" in render(status.warning)
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
    assert "is lost" in render(recorder.file_loss(before.id)) or "goes on as" in render(recorder.file_loss(before.id))
    after = recorder.start()
    sent = stream.feed(recorder, 10)
    recorder.stop()
    recorder.flush()
    with SessionFile(after.path) as session:
        assert [frame.raw for frame in session.frames()] == sent
    assert recorder.file_loss(after.id) is None
