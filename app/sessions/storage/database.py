"""Opening SQLite files the way this package needs them."""

import sqlite3
from pathlib import Path

from app.sessions.errors import NotASession, SessionError
from app.sessions.storage.foreign import Watch, require_own_tables
from app.sessions.storage.migrate import Schema, check, migrate
from app.words import Message

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
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")  # of a new file: its end can be cut off where it is free
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

    A file on a read-only medium is opened too, provided that it was closed; an older one stays at its schema.

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
        # A log left behind by another process cannot be read where nothing may be written beside the file.
        if code_of(error) not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY):
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
