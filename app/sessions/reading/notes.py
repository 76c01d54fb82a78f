"""What people settle about a session after it was recorded, kept in its own file; also while it is still recorded."""

import json
import sqlite3
from pathlib import Path
from typing import Any

from app.sessions.errors import NotASession, RecordingFailed
from app.sessions.storage.database import SESSION, check, migrate, require_own_tables
from app.sessions.storage.queries import StoredSession
from app.sources.data_file import parse_json
from app.words import Message

MOST_BYTES = 1 << 20  # of one value
_BUSY_S = 5.0


def read_note(stored: StoredSession, key: str) -> Any:
    """Return the value of a key, None where nothing was said, or the file is older than notes and cannot be changed."""
    if not stored.rows("SELECT 1 FROM sqlite_master WHERE name = 'notes'"):
        return None
    found = stored.rows("SELECT value FROM notes WHERE key = ? AND length(CAST(value AS BLOB)) <= ?", (key, MOST_BYTES))
    with stored.sound():
        return parse_json(found[0][0]) if found else None


def write_note(path: Path, key: str, value: Any, *, t_wall_ns: int, who: str | None) -> None:
    """Set a key to a value that JSON can hold; None takes it back. The file's way of keeping its log stays as it is.

    Raises:
        NotASession, SchemaTooNew: the file is no session, holds code of its own, or is a newer one.
        RecordingFailed: the disk, or the medium, does not take it.
    """
    if not path.is_file():
        raise NotASession(str(path), Message("no-such-file"))
    uri = f"{path.resolve().as_uri()}?mode=rw"
    try:
        connection = sqlite3.connect(uri, uri=True, timeout=_BUSY_S, isolation_level=None)
        try:
            if check(connection, SESSION, str(path)) == 0:
                raise NotASession(str(path), Message("session-empty"))
            require_own_tables(connection, SESSION, str(path))
            migrate(connection, SESSION, str(path))
            if value is None:
                connection.execute("DELETE FROM notes WHERE key = ?", (key,))
            else:
                row = (key, json.dumps(value), t_wall_ns, who)
                connection.execute("INSERT OR REPLACE INTO notes VALUES (?, ?, ?, ?)", row)
        finally:
            connection.close()
    except sqlite3.OperationalError as error:
        raise RecordingFailed(Message("of-source", source=str(path), reason=str(error))) from error
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
        raise NotASession(str(path), Message("damaged", error=str(error))) from error
