"""Schema versions: numbered SQL files, applied once each, every one in a transaction of its own.

A file's `user_version` is the number of the last step it has seen. Steps that were released are never edited.
"""

import sqlite3
from dataclasses import dataclass
from importlib import resources

from app.sessions.errors import NotASession, SchemaTooNew
from app.words import Message


@dataclass(frozen=True, slots=True)
class Schema:
    """What a kind of file looks like: its mark in the file's header and its steps in order."""

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
    found, current = [], ""
    for line in script.splitlines(keepends=True):
        current += line
        if sqlite3.complete_statement(current):
            found.append(current)
            current = ""
    return found
