"""An SQLite file of our own in the data folder, whose damage stops nobody: it is set aside and a new one made."""

import sqlite3
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from app.sessions.errors import NotASession, RecordingFailed
from app.sessions.storage.database import Schema, code_of, open_for_reading, open_for_writing, require_all_tables
from app.sources.data_file import set_aside
from app.words import Message

T = TypeVar("T")
OnSetAside = Callable[[Path, Path], None]  # the file, and where the damaged one is now
_DAMAGE = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


def nobody_asks(path: Path, kept: Path) -> None:
    """Nobody else has to know; it is in the log."""


class OwnDatabase:
    """One thread at a time changes it; any thread reads meanwhile, and never waits for what the disk does not take."""

    def __init__(self, path: Path, schema: Schema, on_set_aside: OnSetAside = nobody_asks) -> None:
        """Open or create the file; what is no such file is set aside.

        Raises:
            SchemaTooNew: a newer program's.
            RecordingFailed: the disk does not take it.
        """
        self.path = path
        self._schema = schema
        self._on_set_aside = on_set_aside
        self._reading = threading.Lock()
        self._reader: sqlite3.Connection | None = None
        try:
            self._connection = self._open()
        except (sqlite3.Error, OSError) as error:
            raise RecordingFailed(Message("of-source", source=str(path), reason=str(error))) from error
        self._identity = _identity(path)
        with suppress(NotASession, sqlite3.Error):  # damage is met by who reads
            self._opened_reader()  # now: opening waits for a disk that hangs, reading does not

    def run(self, work: Callable[[sqlite3.Connection], T]) -> T:
        """Return what `work` returns; where it meets damage it is called again, on a new file.

        Raises:
            sqlite3.Error: the disk does not take it.
        """
        try:
            return work(self._connection)
        except sqlite3.DatabaseError as error:
            if code_of(error) not in _DAMAGE:
                raise
            self._renew()
            return work(self._connection)

    def read(self, work: Callable[[sqlite3.Connection], T], change: Callable[[Callable[[], T]], T]) -> T:
        """Return what `work` returns of a connection that only reads.

        Where it meets damage, `change` lets the thread that changes the file call `run`, which sets it aside.

        Raises:
            sqlite3.Error: the disk does not give it.
        """
        try:
            with self._reading:
                return work(self._opened_reader())
        except NotASession:
            return change(lambda: self.run(work))
        except sqlite3.DatabaseError as error:
            if code_of(error) not in _DAMAGE:
                raise
            return change(lambda: self.run(work))

    def close(self) -> None:
        """Close the file: the one that changes it last, which takes the log into it."""
        self._close_reader()
        self._connection.close()

    def _opened_reader(self) -> sqlite3.Connection:
        if self._reader is None:
            self._reader = open_for_reading(self.path, self._schema)
            self._reader.text_factory = _text
        return self._reader

    def _close_reader(self) -> None:
        with self._reading:
            if self._reader is not None:
                self._reader.close()
            self._reader = None

    def _renew(self) -> None:
        self._close_reader()
        self._connection.close()
        try:
            if self.path.exists() and _identity(self.path) == self._identity:  # else another program did it
                self._set_aside()
            self._connection = self._open()
        except OSError as error:
            raise sqlite3.OperationalError(str(error)) from error
        self._identity = _identity(self.path)

    def _open(self) -> sqlite3.Connection:
        try:
            return self._open_once()
        except NotASession:
            self._set_aside()
        except sqlite3.DatabaseError as error:
            is_damage = code_of(error) in (*_DAMAGE, sqlite3.SQLITE_ERROR)  # the last: a step met other tables
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


def _identity(path: Path) -> tuple[int, int] | None:
    """What tells a file from another one of the same name; None where there is none."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_dev, stat.st_ino
