"""Whatever becomes of a file of our own, it opens: what is damaged is set aside under a name with the time in it."""

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from app.sessions.black_box_store import BlackBoxStore, StoredBox
from app.sessions.errors import RecordingFailed, SchemaTooNew
from app.sessions.event_log import EventLog
from app.sessions.storage.database import BLACKBOXES, EVENTS
from app.sessions.storage.own_database import nobody_asks
from app.telemetry import Event
from app.words import Message, rendered
from tests.fake_clock import FakeClock


def events(path: Path, on_set_aside) -> EventLog:
    return EventLog(path, FakeClock(), on_set_aside)


def use(store: EventLog | BlackBoxStore, number: int) -> int:
    """Write one more row and return how many there are."""
    if isinstance(store, EventLog):
        store.append(Event(1, "info", "code", Message("verbatim", text=str(number))))
        store.flush()
        return len(store.query(limit=10_000))
    box = StoredBox(str(number), 1.0, None, "", "info", None, rendered(""), True)
    store.add(box, {"noise": os.urandom(500).hex()})
    return len(store.stored())


def sql(path: Path, script: str) -> None:
    with closing(sqlite3.connect(path)) as file:
        file.executescript(script)


def cut(path: Path, end: int) -> None:
    os.truncate(path, end)


def overwrite(path: Path, start: int, data: bytes) -> None:
    with path.open("r+b") as file:
        file.seek(start)
        file.write(data)


def become_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()
    (path / "inside").touch()


TABLES = {"events": events, "blackboxes": BlackBoxStore}
DAMAGES: dict[str, Callable[[Path], object]] = {
    "garbage": lambda path: path.write_bytes(os.urandom(5000)),
    "zeros": lambda path: path.write_bytes(bytes(8192)),
    "a text": lambda path: path.write_text("not found\n" * 100),
    "cut in the header": lambda path: cut(path, 60),
    "cut in the first page": lambda path: cut(path, 3000),
    "cut after the first page": lambda path: cut(path, 4096),
    "garbage in the first page": lambda path: overwrite(path, 100, os.urandom(3000)),
    "garbage in all pages but the first": lambda path: overwrite(path, 4096, os.urandom(path.stat().st_size - 4096)),
    "another program's": lambda path: (path.unlink(), sql(path, "CREATE TABLE mine (a)")),
    "no tables": lambda path: sql(path, "PRAGMA writable_schema = ON; DELETE FROM sqlite_master;"),
    "other tables": lambda path: (
        path.unlink(),
        sql(path, f"CREATE TABLE t (a); PRAGMA application_id = {MARKS[path.stem]}; PRAGMA user_version = 1;"),
    ),
    "a folder": become_folder,
}
MARKS = {"events": EVENTS.application_id, "blackboxes": BLACKBOXES.application_id}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", TABLES)
def test_a_damaged_file_is_set_aside_and_a_new_one_works(tmp_path: Path, name: str, damage: str) -> None:
    path, told = tmp_path / f"{name}.sqlite", []
    first = TABLES[name](path, lambda *both: told.append(both))
    for number in range(200):
        use(first, number)
    first.close()
    for end in ("-wal", "-shm"):
        path.with_name(path.name + end).unlink(missing_ok=True)
    DAMAGES[damage](path)
    second = TABLES[name](path, lambda *both: told.append(both))
    n_rows = use(second, 1000)
    second.close()
    third = TABLES[name](path, lambda *both: told.append(both))
    assert use(third, 1001) == n_rows + 1
    third.close()
    [(of, kept)] = told
    assert of == path
    assert kept.name.startswith(f"{path.name}.damaged-2")
    assert kept.exists()


@pytest.mark.parametrize("name", TABLES)
def test_junk_in_the_log_beside_an_empty_file_is_no_damage(tmp_path: Path, name: str) -> None:
    path, told = tmp_path / f"{name}.sqlite", []
    path.touch()
    for end in ("-wal", "-shm"):
        path.with_name(path.name + end).write_bytes(os.urandom(5000))
    store = TABLES[name](path, lambda *both: told.append(both))
    assert use(store, 1) == 1
    store.close()
    assert not told


@pytest.mark.parametrize("name", TABLES)
def test_damage_that_is_met_later_is_set_aside_too(tmp_path: Path, name: str) -> None:
    path, told = tmp_path / f"{name}.sqlite", []
    store = TABLES[name](path, lambda *both: told.append(both))
    for number in range(300):
        use(store, number)
    with closing(sqlite3.connect(path)) as other:
        other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    overwrite(path, 4096, os.urandom(path.stat().st_size - 4096))
    with closing(sqlite3.connect(path)) as other:  # a change of another connection, so that the cache is dropped
        other.execute("PRAGMA user_version = 2")
    assert use(store, 1000) <= 2
    assert use(store, 1001) <= 3
    store.close()
    assert len(told) == 1
    assert told[0][1].exists()


@pytest.mark.parametrize("name", TABLES)
def test_a_file_of_a_newer_program_is_refused_and_stays(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"{name}.sqlite"
    TABLES[name](path, print).close()
    sql(path, "PRAGMA user_version = 99;")
    with pytest.raises(SchemaTooNew, match=f"{name}.sqlite has schema 99.*update voltwall"):
        TABLES[name](path, print)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_one_that_cannot_be_set_aside_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "blackboxes.sqlite"
    path.write_bytes(b"garbage" * 100)

    def refuse(*_: object) -> None:
        raise PermissionError(13, "refused")

    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(RecordingFailed, match="refused"):
        BlackBoxStore(path)


@pytest.mark.parametrize("name", TABLES)
def test_a_file_that_is_refused_once_is_read_with_its_log(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As by one open file too many while the service starts."""
    path = tmp_path / f"{name}.sqlite"
    TABLES[name](path, nobody_asks).close()
    connect, refused = sqlite3.connect, []

    def refuse_once(database: object, **options: Any) -> sqlite3.Connection:
        if "mode=ro" in str(database) and not refused:
            refused.append(database)
            error = sqlite3.OperationalError("unable to open database file")
            error.sqlite_errorcode = sqlite3.SQLITE_CANTOPEN
            raise error
        return connect(database, **options)

    monkeypatch.setattr(sqlite3, "connect", refuse_once)
    with closing(TABLES[name](path, nobody_asks)) as store:
        assert [use(store, number) for number in range(3)] == [1, 2, 3]
    assert refused
