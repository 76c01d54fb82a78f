"""An SQLite file of our own in the data folder, whose damage stops nobody: it is set aside and a new one made."""

import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from app.sessions.errors import NotASession, RecordingFailed
from app.sessions.storage.database import code_of, open_for_reading, open_for_writing
from app.sessions.storage.files import identity
from app.sessions.storage.foreign import require_all_tables
from app.sessions.storage.migrate import Schema
from app.sources.data_file import set_aside
from app.words import Message

T = TypeVar("T")
OnSetAside = Callable[[Path, Path], None]  # the file, and where the damaged one is now
DAMAGE = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


def nobody_asks(path: Path, kept: Path) -> None:
    """Nobody else has to know; it is in the log."""


class OwnDatabase:
    """One thread at a time."""

    def __init__(self, path: Path, schema: Schema, on_set_aside: OnSetAside = nobody_asks) -> None:
        """Open or create the file; what is no such file is set aside.

        Raises:
            SchemaTooNew: a newer program's.
            RecordingFailed: the disk does not take it.
        """
        self.path = path
        self._schema = schema
        self._on_set_aside = on_set_aside
        try:
            self._connection = self._open()
        except (sqlite3.Error, OSError) as error:
            raise RecordingFailed(Message("of-source", source=str(path), reason=str(error))) from error
        self._identity = identity(path)

    def run(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Return what `work` returns; where it meets damage it is called again, on a new file.

        Raises:
            sqlite3.Error: the disk does not take it.
        """
        try:
            return work(self._connection)
        except sqlite3.DatabaseError as error:
            if code_of(error) not in DAMAGE:
                raise
            self._renew()
            return work(self._connection)

    def reader(self) -> sqlite3.Connection:
        """Return another connection to the file, for a thread that only reads."""
        connection = open_for_reading(self.path, self._schema)
        connection.text_factory = _text
        return connection

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def _renew(self) -> None:
        self._connection.close()
        try:
            if self.path.exists() and identity(self.path) == self._identity:  # else another program did it
                self._set_aside()
            self._connection = self._open()
        except OSError as error:
            raise sqlite3.OperationalError(str(error)) from error
        self._identity = identity(self.path)

    def _open(self) -> sqlite3.Connection:
        try:
            return self._open_once()
        except NotASession:
            self._set_aside()
        except sqlite3.DatabaseError as error:
            is_damage = code_of(error) in (*DAMAGE, sqlite3.SQLITE_ERROR)  # the last: a step met other tables
            if not is_damage and not self.path.is_dir():
                raise
            self._set_aside()
        return self._open_once()

    def _open_once(self) -> sqlite3.Connection:
        connection = open_for_writing(self.path, self._schema)
        try:
            require_all_tables(connection, self._schema, str(self.path))
        except (NotASession, sqlite3.Error):
            connection.close()
            raise
        connection.text_factory = _text
        return connection

    def _set_aside(self) -> None:
        self._on_set_aside(self.path, set_aside(self.path))


def _text(value: bytes) -> str:
    """Text of which a flipped bit takes one character, not the whole list."""
    return value.decode(errors="replace")
