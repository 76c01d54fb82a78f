"""SQLite files the way this package needs them: their versions, opening them, and what one must not do.

Schema steps are numbered SQL files, applied once each, every one in a transaction of its own; the `user_version` of a
file is the number of its last one. Steps that were released are never edited. A file may come from elsewhere: SQLite
runs views, triggers and generated columns when a table is read, so only tables as our own steps make them are let in.
"""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path

from app.sessions.errors import NotASession, SchemaTooNew, SessionError
from app.sources.data_file import LOGS
from app.words import Message


@dataclass(frozen=True, slots=True)
class Schema:
    """Schema of a kind of file: the mark in its header and its steps in order."""

    application_id: int
    steps: tuple[str, ...]
    readable_from: int | None = None  # the oldest version that is read as it is; None: the newest alone

    @property
    def oldest_readable(self) -> int:
        """Reading a file of this version or a newer one changes nothing in it."""
        return self.version if self.readable_from is None else self.readable_from

    @property
    def version(self) -> int:
        """The newest version."""
        return len(self.steps)


def _steps(kind: str) -> tuple[str, ...]:
    folder = resources.files(__package__) / "schema" / kind
    files = sorted((entry for entry in folder.iterdir() if entry.name.endswith(".sql")), key=lambda entry: entry.name)
    return tuple(entry.read_text(encoding="utf-8") for entry in files)


SESSION = Schema(int.from_bytes(b"VWse"), _steps("session"), readable_from=2)
EVENTS = Schema(int.from_bytes(b"VWev"), _steps("events"))
BLACKBOXES = Schema(int.from_bytes(b"VWbb"), _steps("blackboxes"))


def check(connection: sqlite3.Connection, schema: Schema, path: str) -> int:
    """Return the file's schema version, 0 for an empty file.

    Raises:
        NotASession: another program's file, or another kind of ours.
        SchemaTooNew: a newer program wrote it.
    """
    mark = connection.execute("PRAGMA application_id").fetchone()[0]
    version = int(connection.execute("PRAGMA user_version").fetchone()[0])
    is_used = mark or version or connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if is_used and (mark != schema.application_id or version < 0):
        raise NotASession(path, Message("another-kind-of-file"))
    if version > schema.version:
        raise SchemaTooNew(path, version, schema.version)
    return version


def migrate(connection: sqlite3.Connection, schema: Schema, path: str) -> int:
    """Bring the file to the newest version and return how many steps that took; a failing step changes nothing.

    The connection must be in autocommit mode (isolation_level None).

    Raises:
        NotASession, SchemaTooNew: as `check`.
        sqlite3.Error: a step failed.
    """
    taken = 0
    while (version := check(connection, schema, path)) < schema.version:
        connection.execute("BEGIN IMMEDIATE")
        try:
            if check(connection, schema, path) == version:
                for statement in statements(schema.steps[version]):
                    connection.execute(statement)
                connection.execute(f"PRAGMA application_id = {schema.application_id}")
                connection.execute(f"PRAGMA user_version = {version + 1}")
                taken += 1
            connection.execute("COMMIT")
        except sqlite3.Error:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            raise
    return taken


def statements(script: str) -> list[str]:
    """Return the statements of a step."""
    complete, current = [], ""
    for line in script.splitlines(keepends=True):
        current += line
        if sqlite3.complete_statement(current):
            complete.append(current)
            current = ""
    return complete


QUERY_S = 20.0  # time limit of a query; the service's take milliseconds
LENGTH_BYTES = 256 << 20  # bytes of one value
_CHECK_AFTER = 100_000  # instructions of the virtual machine


@cache
def _known(schema: Schema) -> frozenset[tuple[str, str, str | None]]:
    """Kind, name and text of everything that a file of any version of a schema holds."""
    columns: set[tuple[str, str, str | None]] = set()
    connection = sqlite3.connect(":memory:", isolation_level=None)
    try:
        for step in schema.steps:
            for statement in statements(step):
                connection.execute(statement)
            columns.update(connection.execute("SELECT type, name, sql FROM sqlite_master"))
    finally:
        connection.close()
    return frozenset(columns)


def require_own_tables(connection: sqlite3.Connection, schema: Schema, path: str) -> None:
    """Refuse a file with anything but our own tables, as they are, and plain tables that nobody reads.

    Raises:
        NotASession: names what is there.
    """
    columns = _known(schema)
    own = {name for _, name, _ in columns}
    for kind, name, text in connection.execute("SELECT type, name, sql FROM sqlite_master"):
        is_plain = kind == "table" and name not in own and " VIRTUAL " not in f" {text} ".upper()[:40]
        is_automatic = kind == "index" and text is None
        if not ((kind, name, text) in columns or is_plain or is_automatic):
            raise NotASession(path, Message("session-foreign-table", kind=str(kind), name=str(name)[:100]))


@cache
def _newest(schema: Schema) -> frozenset[tuple[str, str, str | None]]:
    """Kind, name and text of everything that a file of the newest version of a schema holds."""
    connection = sqlite3.connect(":memory:", isolation_level=None)
    try:
        migrate(connection, schema, ":memory:")
        return frozenset(connection.execute("SELECT type, name, sql FROM sqlite_master"))
    finally:
        connection.close()


def require_all_tables(connection: sqlite3.Connection, schema: Schema, path: str) -> None:
    """Refuse a file that lacks one of our tables.

    Raises:
        NotASession: names what it lacks.
    """
    there = set(connection.execute("SELECT type, name, sql FROM sqlite_master"))
    if missing := sorted(name for _, name, _ in _newest(schema) - there):
        raise NotASession(path, Message("damaged-lacks", missing=tuple(missing)))


class Watch:
    """Ends a query of a connection that takes longer than QUERY_S."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        connection.execute("PRAGMA trusted_schema = OFF")
        connection.execute("PRAGMA cell_size_check = ON")
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LENGTH_BYTES)
        connection.set_progress_handler(self._check, _CHECK_AFTER)
        self._until_s = float("inf")

    @contextmanager
    def query(self) -> Iterator[None]:
        """One query."""
        self._until_s = time.monotonic() + QUERY_S
        try:
            yield
        finally:
            self._until_s = float("inf")

    def _check(self) -> int:
        return time.monotonic() > self._until_s


_BUSY_S = 5.0


def code_of(error: sqlite3.Error) -> int:
    """Return SQLite's primary result code; 0 of an error that Python raised itself, as over text that is no UTF-8."""
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF


def open_for_writing(path: Path, schema: Schema) -> sqlite3.Connection:
    """Open or create a file, in autocommit mode, at the newest schema. One thread at a time may use it.

    Raises:
        NotASession, SchemaTooNew: the file is not ours to write.
        sqlite3.Error: it cannot be opened or created.
    """
    connection = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")  # a new file's end can be cut off where it is free
        for _ in range(2):  # a fault of the disk leaves the mode as it was, without an error
            if connection.execute("PRAGMA journal_mode = WAL").fetchone() == ("wal",):
                break
        # FULL: the log is forced to the disk at every commit, so a power cut takes only what was not committed.
        # With NORMAL it would take everything since the last checkpoint, minutes of a race.
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA fullfsync = ON")  # macOS: fsync alone leaves data in the drive's cache
        connection.execute("PRAGMA trusted_schema = OFF")
        require_own_tables(connection, schema, str(path))
        migrate(connection, schema, str(path))
    except sqlite3.DatabaseError as error:
        connection.close()
        if code_of(error) == sqlite3.SQLITE_NOTADB:
            raise NotASession(str(path), Message("no-sqlite-file")) from error
        raise
    except SessionError:
        connection.close()
        raise
    except UnicodeDecodeError as error:  # SQLite's own message quotes the damaged bytes
        connection.close()
        raise NotASession(str(path), str(error)) from error
    return connection


def open_for_reading(path: Path, schema: Schema) -> sqlite3.Connection:
    """Open a file without changing it; one of an older schema is brought up to date first, where it can be written.

    A file on a read-only medium is opened too, provided that it was closed; an older one stays at its schema. One whose
    write-ahead log exists is never read without it: what refused it, an open file too many or a disk, may pass.

    Raises:
        NotASession: missing, no SQLite file, damaged, or of another kind.
        SchemaTooNew: a newer program wrote it.
    """
    if not path.is_file():
        raise NotASession(str(path), Message("no-such-file"))
    location = path.resolve().as_uri()
    try:
        return _open_at(f"{location}?mode=ro", path, schema)
    except sqlite3.DatabaseError as error:
        has_log = any(path.with_name(path.name + end).exists() for end in LOGS)
        if has_log or code_of(error) not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY):
            raise NotASession(str(path), str(error)) from error
    try:
        return _open_at(f"{location}?mode=ro&immutable=1", path, schema)
    except sqlite3.DatabaseError as error:
        raise NotASession(str(path), str(error)) from error


def _open_at(uri: str, path: Path, schema: Schema) -> sqlite3.Connection:
    connection = _connect(uri)
    try:
        with Watch(connection).query():
            version = check(connection, schema, str(path))
            require_own_tables(connection, schema, str(path))
    except (sqlite3.DatabaseError, SessionError):
        connection.close()
        raise
    except UnicodeDecodeError as error:  # SQLite's own message quotes the damaged bytes
        connection.close()
        raise NotASession(str(path), str(error)) from error
    if schema.oldest_readable <= version <= schema.version:
        return connection
    connection.close()
    if version == 0:
        raise NotASession(str(path), Message("session-empty"))
    try:
        open_for_writing(path, schema).close()
    except sqlite3.OperationalError as error:
        if code_of(error) not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY):
            raise
        return _connect(uri)
    return _open_at(uri, path, schema)


def _connect(uri: str) -> sqlite3.Connection:
    return sqlite3.connect(uri, uri=True, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
