"""A watch over the file of a session, which any program may delete, replace, cut or fill."""

import sqlite3
import time
from contextlib import suppress
from pathlib import Path

from app.sessions.storage.database import code_of

READ_S = 1.0  # between two times that the content is read
_TRANSIENT_ERRORS = (  # errors that are not the content's: busy, out of memory, the disk fails, no descriptor
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_NOMEM,
    sqlite3.SQLITE_INTERRUPT,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_PROTOCOL,
)
_LOG_MAGIC = (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83")  # https://www.sqlite.org/fileformat2.html#walformat


class FileWatch:
    """Watches the file of a session that is being written; the thread that writes uses it."""

    def __init__(self, path: Path, session_id: str) -> None:
        """Look at the file and its log for the first time; a disk without locks has no log."""
        self._path = path
        self._log = path.with_name(path.name + "-wal")
        self._id = session_id
        self._seen = {owner: state for owner in (path, self._log) if (state := _file(owner)) is not None}
        self._reader: sqlite3.Connection | None = None
        self._read_s = time.monotonic()

    def is_intact(self) -> bool:
        """Return whether file and log are in place, no shorter than before, and still read as the session.

        While a session is written neither becomes shorter: its log is used again from the start, not cut.
        """
        for path, (device, number, size) in self._seen.items():
            now = _file(path)
            if now is None or now[:2] != (device, number) or now[2] < size:
                return False
            self._seen[path] = now
        if time.monotonic() - self._read_s < READ_S:
            return True
        self._read_s = time.monotonic()
        return self._has_log() and self._is_same()

    def written(self) -> None:
        """Note how long the file has become: a commit may have brought the log into it."""
        before, now = self._seen.get(self._path), _file(self._path)
        if before is not None and now is not None and now[:2] == before[:2]:
            self._seen[self._path] = (*now[:2], max(now[2], before[2]))

    @property
    def size_bytes(self) -> int:
        """Return the size of file and log at the last check."""
        return sum(size for _, _, size in self._seen.values())

    def close(self) -> None:
        """Close the file."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _has_log(self) -> bool:
        """Whether the log begins as one: what is written behind a cut leaves zeros before it."""
        if self._log not in self._seen:
            return True
        try:
            with self._log.open("rb") as file:  # SQLite keeps no lock on it that closing would release
                return file.read(4) in _LOG_MAGIC
        except OSError:
            return True

    def _is_same(self) -> bool:
        try:
            if self._reader is None:
                uri = f"{self._path.resolve().as_uri()}?mode=ro"
                self._reader = sqlite3.connect(uri, uri=True, timeout=0, isolation_level=None, check_same_thread=False)
            rows = self._reader.execute("SELECT value FROM meta WHERE key = 'id'").fetchall()
            self._reader.execute("SELECT max(id) FROM frames").fetchall()
        except sqlite3.Error as error:
            with suppress(sqlite3.Error):
                self.close()
            return code_of(error) in _TRANSIENT_ERRORS
        return rows == [(self._id,)]


def _file(path: Path) -> tuple[int, int, int] | None:
    """Return what tells a file from another one of the same name, and its size; None where there is none."""
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_dev, stat.st_ino, stat.st_size
