"""The sessions of a folder."""

import re
import sqlite3
from collections.abc import Sequence
from pathlib import Path

from app.errors import NotNow
from app.sessions.errors import SessionError, SessionNotFound
from app.sessions.info import SessionInfo
from app.sessions.reader import SessionFile

SUFFIX = ".sqlite"
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")


def is_in_use(path: Path) -> bool:
    """Whether another connection, of this or another process, has the file open: being recorded, or read."""
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", uri=True, timeout=0, isolation_level=None)
    try:
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        connection.execute("BEGIN EXCLUSIVE")
        connection.execute("ROLLBACK")
    except sqlite3.DatabaseError as error:
        return error.sqlite_errorcode & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
    finally:
        connection.close()
    return False


class Catalogue:
    """Finds sessions by their id. What is known of closed ones is kept as long as their file does not change."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, tuple[tuple[int, int], SessionInfo]] = {}

    def list(self) -> list[SessionInfo]:
        """All readable sessions, newest first."""
        return [*self.survey()[0]]

    def survey(self) -> tuple[Sequence[SessionInfo], Sequence[SessionError]]:
        """All readable sessions, newest first, and why the other files are not."""
        found: list[SessionInfo] = []
        problems: list[SessionError] = []
        for path in self._folder.glob(f"*{SUFFIX}") if self._folder.is_dir() else ():
            try:
                found.append(self._info(path))
            except SessionError as error:
                problems.append(error)
        found.sort(key=lambda info: (info.started_wall_ns, info.id), reverse=True)
        return found, problems

    def path(self, session_id: str) -> Path:
        """Return where a session is.

        Raises:
            SessionNotFound: no file of this name, or no name that a session can have.
        """
        path = self._folder / f"{session_id}{SUFFIX}"
        if not _ID.fullmatch(session_id) or not path.is_file():
            raise SessionNotFound(session_id)
        return path

    def open(self, session_id: str) -> SessionFile:
        """Open a session for reading.

        Raises:
            SessionNotFound: there is none.
            NotASession, SchemaTooNew: it cannot be read.
        """
        return SessionFile(self.path(session_id))

    def delete(self, session_id: str) -> None:
        """Delete a session for ever, readable or not.

        Raises:
            SessionNotFound: there is none.
            NotNow: it is being recorded or read.
        """
        path = self.path(session_id)
        if is_in_use(path):
            raise NotNow(f"session {session_id} is being recorded or read")
        for name in (path.name, f"{path.name}-wal", f"{path.name}-shm"):
            path.with_name(name).unlink(missing_ok=True)
        self._known.pop(session_id, None)

    def _info(self, path: Path) -> SessionInfo:
        stat = path.stat()
        state = (stat.st_mtime_ns, stat.st_size)
        known = self._known.get(path.stem)
        if known is not None and known[0] == state:
            return known[1]
        with SessionFile(path) as session:
            info = session.info
        if info.is_closed:
            self._known[path.stem] = (state, info)
        return info
