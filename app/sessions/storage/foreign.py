"""What a session file that may come from elsewhere must not do: run code of its own, or never end.

SQLite runs views, triggers and generated columns when a table of that name is read. Only tables as our own steps make
them are let in.
"""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from app.sessions.errors import NotASession
from app.sessions.storage.migrate import Schema, migrate, statements
from app.words import Message

QUERY_S = 20.0  # of one query; those of the service take milliseconds
LENGTH_BYTES = 256 << 20  # of one value
_LOOK_AFTER = 100_000  # instructions of the virtual machine


@cache
def _known(schema: Schema) -> frozenset[tuple[str, str, str | None]]:
    """Kind, name and text of everything that a file of any version of a schema holds."""
    found: set[tuple[str, str, str | None]] = set()
    connection = sqlite3.connect(":memory:", isolation_level=None)
    try:
        for step in schema.steps:
            for statement in statements(step):
                connection.execute(statement)
            found.update(connection.execute("SELECT type, name, sql FROM sqlite_master"))
    finally:
        connection.close()
    return frozenset(found)


def require_own_tables(connection: sqlite3.Connection, schema: Schema, path: str) -> None:
    """Refuse a file with anything but our own tables, as they are, and plain tables that nobody reads.

    Raises:
        NotASession: names what is there.
    """
    known = _known(schema)
    own = {name for _, name, _ in known}
    for kind, name, text in connection.execute("SELECT type, name, sql FROM sqlite_master"):
        is_plain = kind == "table" and name not in own and " VIRTUAL " not in f" {text} ".upper()[:40]
        is_automatic = kind == "index" and text is None
        if not ((kind, name, text) in known or is_plain or is_automatic):
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
        connection.set_progress_handler(self._look, _LOOK_AFTER)
        self._until_s = float("inf")

    @contextmanager
    def query(self) -> Iterator[None]:
        """One query."""
        self._until_s = time.monotonic() + QUERY_S
        try:
            yield
        finally:
            self._until_s = float("inf")

    def _look(self) -> int:
        return time.monotonic() > self._until_s
