import os
import shutil
import sqlite3
from pathlib import Path

import pytest

from app.errors import NotNow
from app.sessions.catalogue import Catalogue
from app.sessions.catalogue_index import INDEX
from app.sessions.errors import SessionNotFound
from app.sessions.recording.recorder import Recorder
from app.sessions.storage.files import is_in_use
from tests.fake_clock import FunctionClock


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


def test_a_file_that_no_address_leads_to_and_a_link_to_nowhere_are_told_apart(recorder: Recorder, folder: Path) -> None:
    good = recorder.start()
    recorder.stop()
    recorder.flush()
    for name in ("Ås test", "new\nline", "x" * 129):
        shutil.copy(good.path, folder / f"{name}.sqlite")
    (folder / "gone.sqlite").symlink_to(folder / "nowhere")
    catalogue = Catalogue(folder)
    sessions, problems = catalogue.survey()
    assert [info.id for info in sessions] == [good.id]
    assert sorted("rename it" in str(problem) for problem in problems) == [False, True, True, True]
    [expired] = catalogue.expired(good.started_wall_ns + 10**18, older_than_s=0)
    assert expired.id == good.id


def test_a_flipped_bit_in_the_names_of_its_tables_makes_one_session_unreadable(
    recorder: Recorder, folder: Path
) -> None:
    good = recorder.start()
    recorder.stop()
    recorder.close()
    content = bytearray(good.path.read_bytes())
    content[content.index(b"CREATE TABLE events") + 2] |= 0x80  # no UTF-8 any more, also where SQLite quotes it
    (folder / "flipped.sqlite").write_bytes(content)
    sessions, problems = Catalogue(folder).survey()
    assert [info.id for info in sessions] == [good.id]
    assert "flipped" in str(problems[0])


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


@pytest.mark.parametrize(
    "index",
    ["", "[]", "{}", '{"version": 1}', '{"version": 99, "sessions": {}}', '{"version": 1, "sessions": {"x": {}}}'],
)
def test_an_index_that_is_damaged_or_newer_is_passed_over(recorder: Recorder, folder: Path, stream, index: str) -> None:
    info = recorder.start()
    stream.feed(recorder, 5)
    recorder.close()
    assert Catalogue(folder).list()[0].frames == 5
    (folder / INDEX).write_text(index)
    assert [each.id for each in Catalogue(folder).list()] == [info.id]


def test_a_session_that_changed_since_the_index_is_opened_again(recorder: Recorder, folder: Path, stream) -> None:
    info = recorder.start("before")
    stream.feed(recorder, 5)
    recorder.close()
    assert Catalogue(folder).list()[0].name == "before"
    connection = sqlite3.connect(info.path)
    connection.execute("UPDATE meta SET value = 'after' WHERE key = 'name'")
    connection.commit()
    connection.close()
    os.utime(info.path, ns=(1, 1))
    assert Catalogue(folder).list()[0].name == "after"
    Catalogue(folder).delete(info.id)
    assert Catalogue(folder).list() == []


def test_a_folder_that_cannot_be_written_is_listed_all_the_same(recorder: Recorder, folder: Path, stream) -> None:
    recorder.start()
    stream.feed(recorder, 5)
    recorder.close()
    (folder / INDEX).mkdir()  # in the index's place: it can be neither read nor replaced
    assert Catalogue(folder).list()[0].frames == 5
    assert [path.name for path in folder.glob(f"{INDEX}*")] == [INDEX]


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


def test_only_what_is_old_or_beyond_the_room_expires(tmp_path: Path) -> None:
    now_ns = 1_790_000_000 * 10**9
    recorder = Recorder(tmp_path, FunctionClock(lambda: now_ns, lambda: now_ns), version="0")
    ids = []
    for _ in range(4):
        ids.append(recorder.start().id)
        recorder.stop()
        recorder.flush()
        now_ns += 86400 * 10**9
    ids.append(recorder.start().id)
    recorder.flush()
    catalogue = Catalogue(tmp_path)
    size = catalogue.list()[1].size_bytes
    assert catalogue.expired(now_ns) == []
    assert [info.id for info in catalogue.expired(now_ns, older_than_s=2.5 * 86400)] == ids[:2]
    room = catalogue.list()[0].size_bytes + 2 * size
    assert [info.id for info in catalogue.expired(now_ns, keep_bytes=room)] == ids[:2]
    assert [info.id for info in catalogue.expired(now_ns, keep_bytes=0, older_than_s=0)] == ids[:4]
    recorder.close()
