import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from app.sessions.errors import NotASession
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.session_info import write_note

FROZEN = Path(__file__).parents[1] / "frozen"


def test_a_note_is_in_the_file_and_the_newest_counts(stream, recorder):
    info = recorder.start()
    stream.feed(recorder, 5)
    recorder.flush()
    write_note(info.path, "laps", [1], t_wall_ns=1, who="anna")  # while it is recorded
    stream.feed(recorder, 5)
    recorder.close()
    with SessionFile(info.path) as session:
        assert session.note("laps") == [1]
        assert session.info.frames == 10
    write_note(info.path, "laps", {"a": 2.5}, t_wall_ns=2, who=None)
    assert [path.name for path in info.path.parent.iterdir()] == [info.path.name]  # a closed session stays one file
    with SessionFile(info.path) as session:
        assert session.note("laps") == {"a": 2.5}
        assert session.note("other") is None
    write_note(info.path, "laps", None, t_wall_ns=3, who=None)
    with SessionFile(info.path) as session:
        assert session.note("laps") is None


def test_a_note_runs_nothing_that_came_with_the_file(recorder):
    info = recorder.start()
    recorder.close()
    with closing(sqlite3.connect(info.path)) as foreign, foreign:
        foreign.execute("CREATE TRIGGER t AFTER INSERT ON notes BEGIN DELETE FROM meta; END")
    with pytest.raises(NotASession, match="trigger t"):
        write_note(info.path, "laps", [1], t_wall_ns=1, who=None)
    with closing(sqlite3.connect(info.path)) as found:
        assert found.execute("SELECT count(*) FROM meta").fetchone()[0] > 0


def test_a_session_older_than_notes_takes_one(tmp_path):
    path = tmp_path / "old.sqlite"
    shutil.copy(FROZEN / "session_1.sqlite", path)
    write_note(path, "laps", [3], t_wall_ns=1, who=None)
    with SessionFile(path) as session:
        assert session.note("laps") == [3]
        assert session.info.frames == 90


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root writes everywhere")
def test_an_old_session_on_a_read_only_medium_opens_as_it_is(tmp_path):
    folder = tmp_path / "medium"
    folder.mkdir()
    shutil.copy(FROZEN / "session_1.sqlite", folder / "old.sqlite")
    (folder / "old.sqlite").chmod(0o444)
    folder.chmod(0o555)
    try:
        with SessionFile(folder / "old.sqlite") as session:
            assert session.info.frames == 90
            assert session.note("laps") is None
    finally:
        folder.chmod(0o755)


@pytest.mark.parametrize("content", [None, b"", b"no database" * 100])
def test_what_is_no_session_takes_no_note(content, tmp_path):
    path = tmp_path / "x.sqlite"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(NotASession):
        write_note(path, "laps", [1], t_wall_ns=1, who=None)
