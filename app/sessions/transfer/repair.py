"""Writes what can still be read of a damaged session into a new one, and says what is lost.

Rows that cannot be read are left out. A frame whose checksum does not hold any more is kept as a damaged one, which is
what it is. Columns are made anew from the frames; estimates come from the columns that can still be unpacked.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from heapq import merge
from itertools import islice
from pathlib import Path
from typing import Any

from app.sessions.errors import NotASession, SessionError
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.session_writer import SessionWriter, TableRow
from app.sessions.storage.digests import COLUMNS
from app.sessions.storage.files import merge_log, remove
from app.sessions.storage.queries import StoredSession
from firmware_protocol.framing import Frame, decode_chunk

BATCH = 2000
_TABLES = ("frames", "can_frames", "measurements", "events", "markers", "configs", "clock")
_AT_ONCE = 512
Progress = Callable[[int, int], None]  # parts done, parts in all


def repair(path: Path, target: Path, on_progress: Progress = lambda done, of: None) -> Counter[str]:
    """Write the session at `path` anew to `target`, which does not exist; return what was lost, by table.

    Args:
        path: of the session.
        target: of the new one.
        on_progress: called with how far it is.

    Raises:
        NotASession, SchemaTooNew: it cannot be opened at all.
        SessionError: the target exists.
        sqlite3.Error, OSError: the target cannot be written.
    """
    if target.exists():
        raise SessionError(f"{target} is there already")
    lost: Counter[str] = Counter()
    stored = StoredSession(path)
    try:
        with SessionFile(path) as session:
            target.touch()
            _write(session, stored, target, lost, on_progress)
    except BaseException:
        remove(target)
        raise
    finally:
        stored.close()
    merge_log(target)
    return lost


def _write(
    session: SessionFile, stored: StoredSession, target: Path, lost: Counter[str], on_progress: Progress
) -> None:
    info = session.info
    start_ns = info.started_mono_ns
    end_ns = max(info.ended_mono_ns or start_ns, start_ns)
    writer = SessionWriter(replace(info, path=target), session.cell_file, session.loaded_battery)
    try:
        tables: list[Iterator[TableRow]] = [
            _in_time(table, _readable(stored, table, lost), start_ns, end_ns, lost) for table in _TABLES
        ]
        items = merge(*tables, _estimates(session, lost), key=lambda item: int(item[1][0]))
        while batch := list(islice(items, BATCH)):
            writer.write(batch)
            writer.close_chunk_if_due(batch[-1][1][0])
            on_progress(min(batch[-1][1][0], end_ns) - start_ns, end_ns - start_ns)
        if info.is_closed:
            writer.close(end_ns, end_ns + info.started_wall_ns - start_ns)
    finally:
        writer.abandon()


def _readable(stored: StoredSession, table: str, lost: Counter[str]) -> Iterator[tuple[Any, ...]]:
    """Rows of a table in the order of their ids, without the ids."""
    try:
        last = stored.last_id(table)
    except NotASession:
        lost[table] += 1
        return
    query = f"SELECT {COLUMNS[table]} FROM {table} WHERE id >= ? AND id < ? ORDER BY id"
    first, size = 1, _AT_ONCE
    while first <= last:
        try:
            rows = stored.rows(query, (first, first + size))
        except NotASession:
            if size == 1:
                lost[table] += 1
                first, size = first + 1, 1
            else:
                size //= 2
            continue
        lost[table] += min(size, last + 1 - first) - len(rows)
        for row in rows:
            yield row[1:]
        first, size = first + size, min(2 * size, _AT_ONCE)


def _in_time(
    table: str, rows: Iterator[tuple[Any, ...]], start_ns: int, end_ns: int, lost: Counter[str]
) -> Iterator[TableRow]:
    """Rows as they are written: in the session's time, each frame marked by its checksum."""
    at_ns = start_ns
    for row in rows:
        is_sound = isinstance(row[0], int) and all(value is not None for value in row[:4])
        if not is_sound:
            lost[table] += 1
            continue
        at_ns = max(at_ns, row[0]) if start_ns <= row[0] <= end_ns else at_ns
        values = (at_ns, *row[1:])
        if table == "frames":
            if not isinstance(row[4], bytes):
                lost[table] += 1
                continue
            is_intact = isinstance(decode_chunk(row[4]), Frame)
            lost["frames now marked as damaged"] += bool(row[3]) and not is_intact
            values = (*values[:3], int(is_intact), row[4])
        yield table, values


def _estimates(session: SessionFile, lost: Counter[str]) -> Iterator[TableRow]:
    """Estimates up to the first that cannot be unpacked; a closed session has no others."""
    try:
        for row in session.estimates():
            yield "estimates", row
    except NotASession:
        lost["estimates from the first damaged column on"] += 1
