"""Black boxes on the disk: one file of their own in the data folder, so that they outlive their sessions."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.sessions.storage.database import BLACKBOXES
from app.sessions.storage.own_database import OnSetAside, Store, nobody_asks, packed
from app.telemetry import Severity
from app.words import RenderedMessage, rendered_as_stored

_COLUMNS = "id, t_wall_ns, session_id, code, severity, cell, text, is_complete, message"


@dataclass(frozen=True)
class StoredBox:
    """What a list shows of a black box."""

    id: str
    time: float  # unix
    session_id: str | None
    code: str
    severity: Severity
    cell: int | None
    message: RenderedMessage  # of the event
    is_complete: bool


class BlackBoxStore:
    """All black boxes of a data folder. Any thread; a box once complete is never replaced by less."""

    def __init__(self, path: Path, on_set_aside: OnSetAside = nobody_asks) -> None:
        """Open or create the file; a damaged one is set aside.

        Raises:
            SchemaTooNew: the file is a newer program's.
            RecordingFailed: the disk does not take it.
        """
        self._store = Store(path, BLACKBOXES, on_set_aside)

    def close(self) -> None:
        """Close the file."""
        self._store.close()

    def add(self, box: StoredBox, body: dict[str, Any]) -> bool:
        """Keep a box, `body` is all of it; False where one that is at least as complete is there.

        Raises:
            RecordingFailed: the disk does not take it.
        """
        row = (
            box.id,
            round(box.time * 1e9),
            box.session_id,
            box.code,
            box.severity,
            box.cell,
            box.message.text,
            int(box.is_complete),
            json.dumps({"code": box.message.code, "args": box.message.args}),
            packed(body),
        )
        changed = self._store.change(
            f"INSERT INTO blackboxes ({_COLUMNS}, body) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (id)"
            " DO UPDATE SET body = excluded.body, is_complete = excluded.is_complete,"
            " session_id = coalesce(excluded.session_id, session_id)"
            " WHERE excluded.is_complete > blackboxes.is_complete",
            row,
        )
        return changed > 0

    def stored(self, session_id: str | None = None) -> list[StoredBox]:
        """All of them, or of one session, newest first."""
        where = "" if session_id is None else " WHERE session_id = ?"
        values = () if session_id is None else (session_id,)
        rows = self._store.rows(f"SELECT {_COLUMNS} FROM blackboxes{where} ORDER BY t_wall_ns DESC, id DESC", values)
        return [
            StoredBox(
                box_id,
                time_ns / 1e9,
                session,
                code,
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
        rows = self._store.rows("SELECT body FROM blackboxes WHERE id = ?", (box_id,))
        return self._store.unpacked(rows[0][0], f"black box {box_id}") if rows else None
