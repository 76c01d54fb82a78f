"""Facts of a session, out of its file alone: no battery is needed, and only SessionError is raised.

A file may come from elsewhere, so every value is held to its type, its range and its length.
"""

import json
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from app.sessions.errors import NotASession, RecordingFailed
from app.sessions.info import SessionInfo
from app.sessions.storage.database import SESSION, check, migrate, require_own_tables
from app.sessions.storage.digests import KEY
from app.sessions.storage.files import size_on_disk
from app.sessions.storage.queries import StoredSession
from app.sources.data_file import parse_json, parse_object
from app.words import Message

MOST_BYTES = 1 << 20  # bytes of one value
_BUSY_S = 5.0


def read_note(stored: StoredSession, key: str) -> Any:
    """Return the value of a key, None where it has none, or the file is older than notes and cannot be changed."""
    if not stored.rows("SELECT 1 FROM sqlite_master WHERE name = 'notes'"):
        return None
    rows = stored.rows("SELECT value FROM notes WHERE key = ? AND length(CAST(value AS BLOB)) <= ?", (key, MOST_BYTES))
    with stored.sound():
        return parse_json(rows[0][0]) if rows else None


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


_NAME_BYTES = 1000
_ALWAYS_THERE = ("id", "name", "voltwall", "map_hash", "start_mono_ns", "start_wall_ns", "metadata")
_KEYS = (*_ALWAYS_THERE, "end_mono_ns", "cell_file", KEY)
_INT64 = range(-(1 << 63), 1 << 63)


def read_info(path: Path) -> SessionInfo:
    """Return what there is to say about a session's file.

    Raises:
        NotASession: missing, damaged, or something else.
        SchemaTooNew: a newer program wrote it.
    """
    with closing(StoredSession(path)) as stored:
        return info_of(stored)


def info_of(stored: StoredSession) -> SessionInfo:
    """Return what there is to say about an open session; quick however long it is.

    Raises:
        NotASession: it is damaged.
    """
    with stored.consistent(), stored.sound():
        meta = meta_of(stored)
        counts = {table: stored.last_id(table) for table in ("frames", "can_frames", "events", "markers")}
        is_closed = "end_mono_ns" in meta
        start = int(meta["start_mono_ns"])
        end = int(meta["end_mono_ns"]) if is_closed else max([start, *_last_times(stored)])
        offset = wall_offset_ns(stored, meta)
        for time_ns in (start, end, start + offset, end + offset):
            if time_ns not in _INT64:
                raise ValueError(f"{time_ns} ns is no time")
        metadata = parse_object(meta["metadata"])
        if tags := read_note(stored, "tags"):
            metadata["tags"] = tags
        size_bytes = size_on_disk(stored.path)
    return SessionInfo(
        id=stored.path.stem,
        path=stored.path,
        name=meta["name"],
        started_wall_ns=start + offset,
        started_mono_ns=start,
        ended_wall_ns=end + offset,
        ended_mono_ns=end,
        is_closed=is_closed,
        size_bytes=size_bytes,
        voltwall=meta["voltwall"],
        map_hash=meta["map_hash"],
        metadata=metadata,
        **counts,
    )


def filled_spans(info: SessionInfo) -> list[tuple[float, float]]:
    """Spans that came from another recorder of the same run, in seconds from the start; what is no span is left out."""
    spans = info.metadata.get("filled")
    return [
        (span[0], span[1])
        for span in (spans if isinstance(spans, list) else ())
        if isinstance(span, list) and len(span) == 2 and all(isinstance(end, int | float) for end in span)
    ]


def meta_of(stored: StoredSession) -> dict[str, str]:
    """Return the values that describe a session, by their key.

    Raises:
        NotASession: one is missing, no text, or too long.
    """
    marks = ", ".join("?" * len(_KEYS))
    rows = stored.rows(
        f"SELECT key, CASE WHEN length(CAST(value AS BLOB)) <= ? THEN value END FROM meta WHERE key IN ({marks})",
        (MOST_BYTES, *_KEYS),
    )
    meta = dict(rows)
    if missing := set(_ALWAYS_THERE) - meta.keys():
        raise NotASession(str(stored.path), Message("damaged-lacks", missing=tuple(sorted(missing))))
    for key, value in meta.items():
        most = _NAME_BYTES if key in ("id", "name", "voltwall", "map_hash") else MOST_BYTES
        if not isinstance(value, str) or len(value.encode()) > most:
            raise NotASession(str(stored.path), Message("session-no-text", key=key, most=most))
    return meta


def wall_offset_ns(stored: StoredSession, meta: Mapping[str, str]) -> int:
    """Return what is added to the monotonic clock for the wall clock, as it was last known."""
    last = stored.rows("SELECT t_wall_ns - t_mono_ns FROM clock ORDER BY id DESC LIMIT 1")
    with stored.sound():
        return int(last[0][0]) if last else int(meta["start_wall_ns"]) - int(meta["start_mono_ns"])


def _last_times(stored: StoredSession) -> list[int]:
    return [
        int(row[0])
        for table in ("frames", "can_frames", "measurements", "clock")
        for row in stored.rows(f"SELECT t_mono_ns FROM {table} ORDER BY id DESC LIMIT 1")
    ]
