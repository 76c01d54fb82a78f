"""A small SQLite file of our own beside the sessions, used by any thread: opening, closing, rows, changes."""

import json
import sqlite3
import threading
import zlib
from pathlib import Path
from typing import Any

from app.sessions.errors import NotASession, RecordingFailed
from app.sessions.storage.database import open_for_writing
from app.sessions.storage.migrate import Schema
from app.words import Message


class Store:
    """One file of a kind; bodies in it are compressed JSON."""

    def __init__(self, path: Path, schema: Schema) -> None:
        """Open or create the file.

        Raises:
            NotASession, SchemaTooNew: the file is something else, or a newer program's.
            RecordingFailed: the disk does not take it.
        """
        self.path = path
        self._lock = threading.Lock()
        try:
            self._connection = open_for_writing(path, schema)
        except sqlite3.Error as error:
            raise RecordingFailed(Message("of-source", source=str(path), reason=str(error))) from error

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._connection.close()

    def change(self, query: str, values: tuple[object, ...]) -> int:
        """Return how many rows a statement changed.

        Raises:
            RecordingFailed: the disk does not take it.
        """
        with self._lock:
            try:
                return self._connection.execute(query, values).rowcount
            except sqlite3.Error as error:
                raise RecordingFailed(Message("of-source", source=str(self.path), reason=str(error))) from error

    def rows(self, query: str, values: tuple[object, ...] = ()) -> list[tuple[Any, ...]]:
        """Return all rows of a query.

        Raises:
            NotASession: the file is damaged.
        """
        with self._lock:
            try:
                return self._connection.execute(query, values).fetchall()
            except sqlite3.DatabaseError as error:
                raise NotASession(str(self.path), Message("damaged", error=str(error))) from error

    def unpacked(self, body: bytes, what: str) -> dict[str, Any]:
        """Return what `packed` made a body of.

        Raises:
            NotASession: it is damaged; says of what.
        """
        try:
            found: dict[str, Any] = json.loads(zlib.decompress(body))
        except (zlib.error, ValueError) as error:
            raise NotASession(str(self.path), Message("part-damaged", what=what, error=str(error))) from error
        return found


def packed(body: dict[str, Any]) -> bytes:
    """Return a body as it is stored."""
    return zlib.compress(json.dumps(body, allow_nan=False, separators=(",", ":")).encode(), 6)
