"""The sessions of a folder."""

import logging
import re
import shutil
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from app.errors import AppError, NotNow
from app.sessions.catalogue_index import FullState, Known, State, full_state, load_index, save_index
from app.sessions.errors import NotASession, SchemaTooNew, SessionNotFound, Unreadable
from app.sessions.info import SessionInfo
from app.sessions.limited_reader import LimitedReader
from app.sessions.reading.parse import Parse, in_process
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.session_info import read_info
from app.sessions.storage.files import FETCHED, SUFFIX, is_in_use, merge_log, remove, sha256
from app.words import Message

TRASH = ".trash"
RESTS_NS = 2 * 10**9  # a file changed within it may change again within the same tick of its clock
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")

log = logging.getLogger(__name__)


class Catalogue:
    """Finds sessions by their id. What is known of closed ones is kept as long as their file does not change.

    Also over restarts: in an index next to them, which is only a shortcut. What cannot be read is not tried again
    before its file changes.
    """

    def __init__(self, folder: Path, reader: LimitedReader | None = None) -> None:
        """Without `reader` sessions are read in this process."""
        self._folder = folder
        self.read_info = read_info if reader is None else reader.info
        self.parse: Parse = in_process if reader is None else reader.parse
        self._surveying = threading.Lock()
        self._known: Known | None = None  # the index is read when first asked for
        self._others: dict[str, tuple[FullState, SessionInfo | Unreadable]] = {}  # neither finished nor sound
        self._digests: dict[str, tuple[State, bytes]] = {}

    def list(self) -> list[SessionInfo]:
        """All readable sessions, newest first."""
        return [*self.survey()[0]]

    def survey(self) -> tuple[Sequence[SessionInfo], Sequence[Unreadable]]:
        """All readable sessions, newest first, and why the other files are not."""
        with self._surveying:
            return self._survey()

    def _survey(self) -> tuple[Sequence[SessionInfo], Sequence[Unreadable]]:
        sessions: list[SessionInfo] = []
        problems: list[Unreadable] = []
        before = load_index(self._folder) if self._known is None else self._known
        indexed: Known = {}
        others: dict[str, tuple[FullState, SessionInfo | Unreadable]] = {}
        for path in self._folder.glob(f"*{SUFFIX}") if self._folder.is_dir() else ():
            info = self._info(path, before, indexed, others)
            if isinstance(info, SessionInfo):
                sessions.append(info)
            else:
                problems.append(info)
        self._known, self._others = indexed, others  # first: where the disk hangs it is asked once
        if indexed != before:
            save_index(self._folder, indexed)
        sessions.sort(key=lambda info: (info.started_wall_ns, info.id), reverse=True)
        return sessions, problems

    def _info(
        self,
        path: Path,
        before: Known,
        indexed: Known,
        others: dict[str, tuple[FullState, SessionInfo | Unreadable]],
    ) -> SessionInfo | Unreadable:
        """What there is to say about a session, or why it cannot be read: out of what is known of the same file.

        What is found goes into `known` where the session is finished, into `others` where its file rests.
        """
        if not _ID.fullmatch(path.stem):
            return NotASession(str(path), Message("session-file-name"))
        try:
            state = full_state(path)
        except OSError as error:  # deleted meanwhile, a link to nowhere
            return NotASession(str(path), error.strerror or str(error))
        row = before.get(path.stem)
        if row is not None and row[0] == state[:2]:
            indexed[path.stem] = row
            return row[1]
        other = self._others.get(path.stem)
        if other is not None and other[0] == state:
            others[path.stem] = other
            return other[1]
        info = self._read(path)
        if isinstance(info, SessionInfo) and info.is_closed:
            indexed[path.stem] = (state[:2], info)
        elif info is not None and time.time_ns() - max(state) > RESTS_NS:
            others[path.stem] = (state, info)
        return info or NotASession(str(path), Message("workers-busy"))

    def _read(self, path: Path) -> SessionInfo | Unreadable | None:
        """What a file says, or why it does not; None where that cannot be asked now."""
        try:
            return self.read_info(path)
        except (NotASession, SchemaTooNew) as error:
            return error.with_traceback(None)
        except NotNow:
            return None
        except AppError as error:
            return NotASession(str(path), error.message)
        except Exception as error:  # one file hides no other
            log.exception("%s cannot be read", path)
            return NotASession(str(path), Message("damaged", error=f"{type(error).__name__}: {error}"))

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
        return self.open_file(self.path(session_id))

    def open_file(self, path: Path) -> SessionFile:
        """Open a session's file for reading, as `open`."""
        return SessionFile(path, parse=self.parse)

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
        digest = self._digests.get(session_id)
        if digest is None or digest[0] != state:
            digest = self._digests[session_id] = state, sha256(path)
        return path, digest[1]

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
        sessions: list[SessionInfo] = []
        kept_bytes = 0
        for info in self.survey()[0]:
            kept_bytes += info.size_bytes
            age_s = (now_ns - (info.ended_wall_ns or info.started_wall_ns)) / 1e9
            is_old = older_than_s is not None and age_s > older_than_s
            is_beyond = keep_bytes is not None and kept_bytes > keep_bytes
            if (is_old or is_beyond) and not is_in_use(info.path):
                sessions.insert(0, info)
        return sessions
