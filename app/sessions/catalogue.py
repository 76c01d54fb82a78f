"""The sessions of a folder."""

import re
import shutil
from collections.abc import Sequence
from pathlib import Path

from app.errors import NotNow
from app.sessions.catalogue_index import Known, State, load_index, save_index
from app.sessions.errors import NotASession, SessionError, SessionNotFound
from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile
from app.sessions.storage.files import FETCHED, SUFFIX, is_in_use, merge_log, remove, sha256
from app.words import Message

TRASH = ".trash"
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")


class Catalogue:
    """Finds sessions by their id. What is known of closed ones is kept as long as their file does not change.

    Also over restarts: in an index beside them, which is only a shortcut.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: Known | None = None  # the index is read when first asked for
        self._digests: dict[str, tuple[State, bytes]] = {}

    def list(self) -> list[SessionInfo]:
        """All readable sessions, newest first."""
        return [*self.survey()[0]]

    def survey(self) -> tuple[Sequence[SessionInfo], Sequence[SessionError]]:
        """All readable sessions, newest first, and why the other files are not."""
        found: list[SessionInfo] = []
        problems: list[SessionError] = []
        before = load_index(self._folder) if self._known is None else self._known
        known: Known = {}
        for path in self._folder.glob(f"*{SUFFIX}") if self._folder.is_dir() else ():
            try:
                found.append(_info(path, before, known))
            except SessionError as error:
                problems.append(error)
        if known != before:
            save_index(self._folder, known)
        self._known = known
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

    def closed_file(self, session_id: str) -> tuple[Path, bytes] | None:
        """Return a session's file and its SHA-256, None while more may come: it is being recorded.

        Raises:
            SessionNotFound: there is none.
        """
        path = self.path(session_id)
        if not merge_log(path):
            return None
        stat = path.stat()
        state = (stat.st_mtime_ns, stat.st_size)
        known = self._digests.get(session_id)
        if known is None or known[0] != state:
            known = self._digests[session_id] = state, sha256(path)
        return path, known[1]

    def delete(self, session_id: str) -> None:
        """Delete a session for ever, readable or not.

        Raises:
            SessionNotFound: there is none.
            NotNow: it is being recorded or read.
        """
        path = self.path(session_id)
        if is_in_use(path):
            raise NotNow(f"session {session_id} is being recorded or read")
        remove(path)
        self._digests.pop(session_id, None)

    def discard(self, session_id: str) -> None:
        """Move a session into the trash folder, from which it can be taken back by hand.

        Raises:
            SessionNotFound: there is none.
            NotNow: it is being recorded or read.
            OSError: it cannot be moved.
        """
        path = self.path(session_id)
        if is_in_use(path) or not merge_log(path):
            raise NotNow(f"session {session_id} is being recorded or read")
        trash = self._folder / TRASH
        trash.mkdir(exist_ok=True)
        for name in (path.name, path.name + FETCHED):
            source = path.with_name(name)
            if source.exists():
                source.replace(trash / name)
                (trash / name).touch()
        self._digests.pop(session_id, None)

    def empty_trash(self, before_ns: int, free_bytes: int) -> None:
        """Delete what came into the trash before an instant; all of it where the disk has less than that free."""
        trash = self._folder / TRASH
        for path in trash.iterdir() if trash.is_dir() else ():
            if path.stat().st_mtime_ns < before_ns or shutil.disk_usage(trash).free < free_bytes:
                path.unlink(missing_ok=True)

    def expired(
        self, now_ns: int, *, older_than_s: float | None = None, keep_bytes: int | None = None
    ) -> Sequence[SessionInfo]:
        """Return what could be deleted, oldest first: ended longer ago, or beyond so many bytes of newer ones.

        What is being recorded or read is never among them.
        """
        found: list[SessionInfo] = []
        kept_bytes = 0
        for info in self.survey()[0]:
            kept_bytes += info.size_bytes
            age_s = (now_ns - (info.ended_wall_ns or info.started_wall_ns)) / 1e9
            is_old = older_than_s is not None and age_s > older_than_s
            is_beyond = keep_bytes is not None and kept_bytes > keep_bytes
            if (is_old or is_beyond) and not is_in_use(info.path):
                found.insert(0, info)
        return found


def _info(path: Path, before: Known, known: Known) -> SessionInfo:
    """What there is to say about a session; of a closed one put into `known`, out of `before` where it is there.

    Raises:
        SessionError: it cannot be read, or by no address.
    """
    if not _ID.fullmatch(path.stem):
        raise NotASession(str(path), Message("session-file-name"))
    try:
        stat = path.stat()
    except OSError as error:  # deleted meanwhile, a link to nowhere
        raise NotASession(str(path), error.strerror or str(error)) from error
    state = (stat.st_mtime_ns, stat.st_size)
    row = before.get(path.stem)
    if row is None or row[0] != state:
        with SessionFile(path) as session:
            row = (state, session.info)
    if row[1].is_closed:
        known[path.stem] = row
    return row[1]
