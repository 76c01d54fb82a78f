"""Black boxes on the disk: one file of their own in the data folder, so that they outlive their sessions."""

import json
import sqlite3
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import orjson

from app.sessions.errors import NotASession, RecordingFailed
from app.sessions.storage.database import BLACKBOXES
from app.sessions.storage.own_database import OnSetAside, OwnDatabase, nobody_asks
from app.telemetry import Severity
from app.words import Message, RenderedMessage, condition_of, rendered_as_stored

_TIME = len("20260921T141500.250Z")  # length of an id's time
_COLUMNS = "id, t_wall_ns, session_id, code, severity, cell, text, is_complete, message"


@dataclass(frozen=True)
class StoredBox:
    """A black box as a list shows it."""

    id: str
    time: float  # unix
    session_id: str | None
    code: str
    severity: Severity
    cell: int | None
    message: RenderedMessage  # text of the event
    is_complete: bool


class BlackBoxStore:
    """All black boxes of a data folder. Any thread; a box once complete is never replaced by less."""

    def __init__(self, path: Path, on_set_aside: OnSetAside = nobody_asks) -> None:
        """Open or create the file; a damaged one is set aside.

        Raises:
            SchemaTooNew: the file is a newer program's.
            RecordingFailed: the disk does not take it.
        """
        self._path = path
        self._lock = threading.Lock()
        self._database = OwnDatabase(path, BLACKBOXES, on_set_aside)

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._database.close()

    def add(self, box: StoredBox, body: dict[str, Any], *, revises: bool = False) -> bool:
        """Keep a box, `body` is all of it; False where one that is at least as complete is there.

        With `revises` it takes the place of one that is no more complete.

        Raises:
            RecordingFailed: the disk does not take it.
        """
        stored = self._rows("SELECT id FROM blackboxes WHERE substr(id, 1, ?) = ?", (_TIME, box.id[:_TIME]))
        row = (
            stored[0][0] if stored else box.id,  # an earlier version named the same incident by another code
            round(box.time * 1e9),
            box.session_id,
            box.code,
            box.severity,
            box.cell,
            box.message.text,
            int(box.is_complete),
            json.dumps({"code": box.message.code, "args": box.message.args}),
            zlib.compress(json.dumps(body, allow_nan=False, separators=(",", ":")).encode(), 6),
        )
        insert = (
            f"INSERT INTO blackboxes ({_COLUMNS}, body) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (id)"
            " DO UPDATE SET body = excluded.body, is_complete = excluded.is_complete,"
            " session_id = coalesce(excluded.session_id, session_id)"
            f" WHERE excluded.is_complete {'>=' if revises else '>'} blackboxes.is_complete"
        )
        with self._lock, self._on_disk():
            return self._database.run(lambda connection: connection.execute(insert, row).rowcount) > 0

    def stored(self, session_id: str | None = None) -> list[StoredBox]:
        """All of them, or of one session, newest first."""
        where = "" if session_id is None else " WHERE session_id = ?"
        values = () if session_id is None else (session_id,)
        rows = self._rows(f"SELECT {_COLUMNS} FROM blackboxes{where} ORDER BY t_wall_ns DESC, id DESC", values)
        return [
            StoredBox(
                box_id,
                time_ns / 1e9,
                session,
                condition_of(code),
                severity,
                cell,
                rendered_as_stored(text, message),
                bool(is_complete),
            )
            for box_id, time_ns, session, code, severity, cell, text, is_complete, message in rows
        ]

    def get(self, box_id: str) -> dict[str, Any] | None:
        """Return a box, None where there is none of this id.

        Raises:
            NotASession: it cannot be read.
        """
        rows = self._rows("SELECT body FROM blackboxes WHERE id = ?", (box_id,))
        try:
            return orjson.loads(zlib.decompress(rows[0][0])) if rows else None
        except (zlib.error, TypeError, ValueError) as error:
            damaged = Message("part-damaged", what=f"black box {box_id}", error=str(error))
            raise NotASession(str(self._path), damaged) from error

    def _rows(self, query: str, values: tuple[object, ...]) -> list[tuple[Any, ...]]:
        """All rows of a query, also while a change waits for the disk."""

        def locked(work: Callable[[], list[tuple[Any, ...]]]) -> list[tuple[Any, ...]]:
            with self._lock:
                return work()

        with self._on_disk():
            return self._database.read(lambda connection: connection.execute(query, values).fetchall(), locked)

    @contextmanager
    def _on_disk(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise RecordingFailed(Message("of-source", source=str(self._path), reason=str(error))) from error
