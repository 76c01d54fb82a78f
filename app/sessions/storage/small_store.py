"""A small SQLite file of our own beside the sessions, used by any thread: opening, closing, rows, changes."""

import json
import sqlite3
import threading
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import orjson

from app.sessions.errors import NotASession, RecordingFailed
from app.sessions.storage.migrate import Schema
from app.sessions.storage.own_database import OnSetAside, OwnDatabase, nobody_asks
from app.words import Message

T = TypeVar("T")


class Store:
    """One file of a kind; bodies in it are compressed JSON."""

    def __init__(self, path: Path, schema: Schema, on_set_aside: OnSetAside = nobody_asks) -> None:
        """Open or create the file; a damaged one is set aside, now or when its damage is met.

        Raises:
            SchemaTooNew: the file is a newer program's.
            RecordingFailed: the disk does not take it.
        """
        self.path = path
        self._lock = threading.Lock()
        self._database = OwnDatabase(path, schema, on_set_aside)

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._database.close()

    def change(self, query: str, values: tuple[object, ...]) -> int:
        """Return how many rows a statement changed.

        Raises:
            RecordingFailed: the disk does not take it.
        """
        with self._lock:
            try:
                return self._database.run(lambda connection: connection.execute(query, values).rowcount)
            except sqlite3.Error as error:
                raise RecordingFailed(Message("of-source", source=str(self.path), reason=str(error))) from error

    def rows(self, query: str, values: tuple[object, ...] = ()) -> list[tuple[Any, ...]]:
        """Return all rows of a query, also while a change waits for the disk.

        Raises:
            RecordingFailed: the disk does not give them.
        """
        try:
            return self._database.read(lambda connection: connection.execute(query, values).fetchall(), self._locked)
        except sqlite3.Error as error:
            raise RecordingFailed(Message("of-source", source=str(self.path), reason=str(error))) from error

    def _locked(self, work: Callable[[], T]) -> T:
        with self._lock:
            return work()

    def unpacked(self, body: bytes, what: str) -> dict[str, Any]:
        """Return what `packed` made a body of.

        Raises:
            NotASession: it is damaged; says of what.
        """
        try:
            found: dict[str, Any] = orjson.loads(zlib.decompress(body))
        except (zlib.error, TypeError, ValueError) as error:
            raise NotASession(str(self.path), Message("part-damaged", what=what, error=str(error))) from error
        return found


def packed(body: dict[str, Any]) -> bytes:
    """Return a body as it is stored."""
    return zlib.compress(json.dumps(body, allow_nan=False, separators=(",", ":")).encode(), 6)
