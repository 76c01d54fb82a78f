import sqlite3
from pathlib import Path

import pytest

from app.sessions.errors import NotASession, SchemaTooNew
from app.sessions.storage.database import EVENTS, SESSION, Schema, migrate, open_for_reading, open_for_writing

ONE = Schema(7, ("CREATE TABLE a (x);\nINSERT INTO a VALUES (1);",))
TWO = Schema(7, (*ONE.steps, "ALTER TABLE a ADD COLUMN y DEFAULT 'new; text';"))
BROKEN = Schema(7, (*ONE.steps, "CREATE TABLE b (x);\nINSERT INTO nowhere VALUES (1);"))


def test_an_old_file_is_brought_up_to_date_once(tmp_path: Path) -> None:
    path = tmp_path / "f.sqlite"
    open_for_writing(path, ONE).close()
    for _ in range(2):
        connection = open_for_reading(path, TWO)
        assert connection.execute("SELECT * FROM a").fetchall() == [(1, "new; text")]
        connection.close()
    with pytest.raises(SchemaTooNew):
        open_for_reading(path, ONE)


def test_a_failing_step_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "f.sqlite"
    open_for_writing(path, ONE).close()
    connection = sqlite3.connect(path, isolation_level=None)
    with pytest.raises(sqlite3.OperationalError, match="nowhere"):
        migrate(connection, BROKEN, "f")
    assert connection.execute("SELECT name FROM sqlite_master").fetchall() == [("a",)]
    assert connection.execute("PRAGMA user_version").fetchone() == (1,)
    assert migrate(connection, TWO, "f") == 1
    connection.close()


@pytest.mark.parametrize(("made", "opened"), [(SESSION, EVENTS), (EVENTS, SESSION)])
def test_the_two_kinds_of_file_are_not_mixed_up(tmp_path: Path, made: Schema, opened: Schema) -> None:
    open_for_writing(tmp_path / "f", made).close()
    with pytest.raises(NotASession):
        open_for_reading(tmp_path / "f", opened)
    with pytest.raises(NotASession):
        open_for_writing(tmp_path / "f", opened)


def test_every_step_is_numbered_without_a_hole() -> None:
    from importlib import resources

    for kind in ("session", "events"):
        names = sorted(e.name for e in (resources.files("app.sessions.storage") / "schema" / kind).iterdir())
        assert [int(name[:4]) for name in names] == list(range(1, len(names) + 1))
