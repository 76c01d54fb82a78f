"""Queries on a session's file: by any thread, of one instant where that matters, with our own errors."""

import math
import sqlite3
import struct
import threading
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from app.sessions.errors import NotASession
from app.sessions.storage.database import SESSION, Watch, open_for_reading
from app.words import Message

FETCH_ROWS = 500
_KINDS = {"INTEGER": (int,), "REAL": (int, float), "TEXT": (str,), "BLOB": (bytes,)}
_BUS_SINCE = 5  # schema
_OLD_TABLES = """
CREATE TEMP VIEW can_frames AS
    SELECT id, t_mono_ns, t_wall_ns, can_id & ~(3 << 29) AS can_id, data, can_id >> 29 & 3 AS bus FROM main.can_frames;
CREATE TEMP TABLE measurements (id INTEGER PRIMARY KEY, t_mono_ns INTEGER, t_wall_ns INTEGER, numbers BLOB);
"""  # an older file as the newest schema has it; nothing in it changes


class StoredSession:
    """A session's file, opened for reading. Every method raises NotASession where the file is damaged."""

    def __init__(self, path: Path) -> None:
        """Open the file.

        Raises:
            NotASession: missing, damaged, or something else.
            SchemaTooNew: a newer program wrote it.
        """
        self.path = path
        self._connection = open_for_reading(path, SESSION)
        if self._connection.execute("PRAGMA user_version").fetchone()[0] < _BUS_SINCE:
            self._connection.executescript(_OLD_TABLES)
        self._watch = Watch(self._connection)
        self._lock = threading.RLock()

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._connection.close()

    @contextmanager
    def consistent(self) -> Iterator[None]:
        """Everything read inside is of one instant, whatever is recorded meanwhile."""
        with self._lock:
            if self._connection.in_transaction:
                yield
                return
            with self._translated():
                self._connection.execute("BEGIN")
            try:
                yield
            finally:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")

    def rows(self, query: str, values: Sequence[object] = ()) -> list[tuple[Any, ...]]:
        """Return all rows of a query."""
        with self._lock, self._translated(), self._watch.query():
            return self._connection.execute(query, values).fetchall()

    def table(self, name: str) -> list[dict[str, Any]]:
        """Return all rows of a small table in the order of their ids, by the names of its columns.

        Raises:
            NotASession: also where a value is not of the kind that its column is declared as.
        """
        kinds = {row[1]: (_KINDS[row[2]], bool(row[3])) for row in self.rows(f"PRAGMA table_info({name})")}
        rows = [dict(zip(kinds, row, strict=True)) for row in self.rows(f"SELECT * FROM {name} ORDER BY id")]
        for row in rows:
            for column, value in row.items():
                kind, is_needed = kinds[column]
                is_sound = not is_needed if value is None else isinstance(value, kind)
                if not is_sound or (isinstance(value, float) and not math.isfinite(value)):
                    raise NotASession(str(self.path), Message("damaged", error=f"{name}.{column}"))
        return rows

    def check_pages(self) -> list[str]:
        """Return what SQLite finds wrong with the file, however long that takes."""
        with self._lock, self._translated():
            return [row[0] for row in self._connection.execute("PRAGMA quick_check(10)") if row[0] != "ok"]

    def last_id(self, table: str) -> int:
        """Return how many rows a table has, whose ids count from 1; 0 for an empty one."""
        return int(self.rows(f"SELECT coalesce(max(id), 0) FROM {table}")[0][0])

    def iterate(self, table: str, columns: str, first_ns: int | None, last_ns: int | None) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a range of monotonic time, ends included, in the order in which they were recorded.

        The first of the columns must be t_mono_ns.
        """
        first = 1 if first_ns is None else self._first_id_at(table, first_ns)
        while True:
            rows = self.rows(
                f"SELECT id, {columns} FROM {table} WHERE id >= ? ORDER BY id LIMIT {FETCH_ROWS}", (first,)
            )
            for row in rows:
                if last_ns is not None and row[1] > last_ns:
                    return
                yield row[1:]
            if len(rows) < FETCH_ROWS:
                return
            first = rows[-1][0] + 1

    def count(self, table: str, first_ns: int | None, last_ns: int | None) -> int:
        """Return how many rows `iterate` yields; their ids have no gaps."""
        first = 1 if first_ns is None else self._first_id_at(table, first_ns)
        end = self.last_id(table) + 1 if last_ns is None else self._first_id_at(table, last_ns + 1)
        return max(end - first, 0)

    def rows_between(self, table: str, columns: str, first_ns: int, end_ns: int) -> tuple[int, list[tuple[Any, ...]]]:
        """Return the id of the first row at or after `first_ns`, and all rows from it that are before `end_ns`."""
        with self.consistent():
            first, end = self._first_id_at(table, first_ns), self._first_id_at(table, end_ns)
            return first, self.rows(f"SELECT {columns} FROM {table} WHERE id >= ? AND id < ? ORDER BY id", (first, end))

    def part_of_column(self, column_id: int, start: int, end: int) -> bytes:
        """Return some bytes of a column's data without reading the others."""
        with (
            self._lock,
            self._translated(),
            self._connection.blobopen("columns", "data", column_id, readonly=True) as blob,
        ):
            blob.seek(start)
            return blob.read(end - start)

    def backup(self, path: Path) -> None:
        """Write all of it, as it is now, into one file without a log."""
        target = sqlite3.connect(path)
        try:
            with self._lock, self._translated():
                self._connection.backup(target)
            target.execute("PRAGMA journal_mode = DELETE")
        finally:
            target.close()

    def _first_id_at(self, table: str, t_mono_ns: int) -> int:
        with self.consistent():
            low, high = 1, self.last_id(table) + 1
            while low < high:
                middle = (low + high) // 2
                ((time_ns,),) = self.rows(f"SELECT t_mono_ns FROM {table} WHERE id = ?", (middle,))
                low, high = (middle + 1, high) if time_ns < t_mono_ns else (low, middle)
        return low

    @contextmanager
    def sound(self) -> Iterator[None]:
        """Raise NotASession for rows that do not have the shape they were written in."""
        try:
            yield
        except (ArithmeticError, LookupError, TypeError, ValueError, struct.error, zlib.error) as error:
            raise NotASession(str(self.path), Message("damaged", error=str(error))) from error

    @contextmanager
    def _translated(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            raise NotASession(str(self.path), Message("damaged", error=str(error))) from error
