from pathlib import Path

import pytest

from app.errors import NotNow
from app.sessions.catalogue import Catalogue, is_in_use
from app.sessions.errors import SessionNotFound
from app.sessions.writer import Recorder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "sessions"


def test_sessions_are_listed_newest_first_and_damaged_files_apart(recorder: Recorder, folder: Path) -> None:
    ids = []
    for _ in range(3):
        ids.append(recorder.start().id)
        recorder.stop()
    recorder.flush()
    (folder / "broken.sqlite").write_bytes(b"not a database, not a database")
    sessions, problems = Catalogue(folder).survey()
    assert [info.id for info in sessions] == ids[::-1]
    assert len(problems) == 1
    assert "broken" in str(problems[0])


def test_the_list_follows_a_session_that_grows(recorder: Recorder, folder: Path, stream) -> None:
    catalogue = Catalogue(folder)
    assert catalogue.list() == []
    recorder.start()
    for expected in (10, 20):
        stream.feed(recorder, 10)
        recorder.flush()
        assert catalogue.list()[0].frames == expected
    recorder.stop()
    recorder.flush()
    assert catalogue.list()[0].is_closed
    assert catalogue.list() == Catalogue(folder).list()


def test_a_running_session_is_in_use_and_cannot_be_deleted(recorder: Recorder, folder: Path, stream) -> None:
    info = recorder.start()
    stream.feed(recorder, 3)
    recorder.flush()
    assert is_in_use(info.path)
    with pytest.raises(NotNow):
        Catalogue(folder).delete(info.id)
    stream.feed(recorder, 3)
    recorder.stop()
    recorder.flush()
    assert not is_in_use(info.path)
    Catalogue(folder).delete(info.id)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("session_id", ["nothing", "../x", "", ".hidden", "a/b", "..", "a\\b", "a\0b", "x" * 300])
def test_an_id_never_leads_out_of_the_folder(folder: Path, session_id: str) -> None:
    folder.mkdir()
    (folder.parent / "x.sqlite").touch()
    (folder / ".hidden.sqlite").touch()
    with pytest.raises(SessionNotFound):
        Catalogue(folder).path(session_id)
