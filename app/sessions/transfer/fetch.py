"""Brings the sessions of another voltwall, a recorder in the car, into this folder; goes on where it was cut off."""

import base64
import hashlib
import http.client
import re
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from urllib.parse import urlsplit

from app.errors import ConfigError, LimitExceeded, WorkerEnded, message_of
from app.sessions.errors import FetchFailed, SessionError
from app.sessions.info import SessionInfo
from app.sessions.reading.session_info import read_info
from app.sessions.storage.files import FETCHED, SUFFIX
from app.sessions.transfer.trust import opener
from app.sources.data_file import MOST_DEPTH, parse_json, parse_object
from app.words import Message, Text

TIMEOUT_S = 15.0
PIECES_TIMEOUT_S = 60.0  # over a link that loses much: TCP tries again after 1, 3, 7, 15, 31 s
ATTEMPTS = 5  # in a row without a single byte
PAUSE_S = 0.5  # before the second attempt; twice as long before each further one
PIECE_BYTES = 1 << 16
MOST_PIECES = 1_000_000  # pieces of a session: 115 days
LIST_BYTES = 32 << 20  # bytes of a list of sessions; a season's has less than 1 MB
LIST_S = 120  # for all of an answer that is no session
_HEAD = {  # what a head has to hold
    "id": str, "name": str, "voltwall": str, "map_hash": str, "metadata": dict, "start_mono_ns": int,
    "start_wall_ns": int, "closed": bool, "recording": bool, "pieces": int, "bytes": int, "frames": int,
    "can_frames": int, "battery_files": list,
}  # fmt: skip
Progress = Callable[[int, int], None]  # bytes here, bytes in all


@dataclass(frozen=True, slots=True)
class RemoteSession:
    """A session that another service has."""

    id: str
    name: str
    started_s: float
    duration_s: float
    size_bytes: int
    is_recording: bool


def reason_of(error: BaseException) -> Text:
    """Return the fault of a connection, in the system's words alone: `Connection refused`."""
    inner = error.reason if isinstance(error, urllib.error.URLError) else error
    if isinstance(inner, OSError) and inner.strerror:
        return inner.strerror
    return message_of(inner) if isinstance(inner, BaseException) else str(inner)


class Remote:
    """Another voltwall service."""

    def __init__(
        self,
        url: str,
        *,
        label: str = "",
        password: str | None = None,
        trust: str | None = None,
        sleep: Callable[[float], None] = time.sleep,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Only keep what is given; nothing is asked yet.

        Args:
            url: where it is, as http://car.local:8000.
            label: what its sessions are called here, before their id; the host's name where empty.
            password: its viewer's or engineer's, or a token.
            trust: its certificate, where the system does not know it: a file or fingerprints, see `context_for`.
            sleep: waits between attempts.
            monotonic_s: the clock by which an answer is too slow.

        Raises:
            ConfigError: the URL, the label or `trust` cannot be one.
        """
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ConfigError("url", url, Message("url-form"))
        self.url = f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}"
        self.label = label or re.sub(r"[^A-Za-z0-9]+", "-", parts.hostname).strip("-")
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,40}", self.label):
            raise ConfigError("label", label, Message("label-form"))
        self._password = password
        self._opener = opener(trust)
        self._sleep = sleep
        self._monotonic_s = monotonic_s

    def sessions(self) -> list[RemoteSession]:
        """Return what it has, newest first.

        Raises:
            FetchFailed: it does not answer, or not as a voltwall.
        """
        with self._answers():
            return [
                RemoteSession(
                    str(session["id"]),
                    str(session["name"]),
                    float(session["started"]),
                    float(session["duration_s"] or 0),
                    int(session["bytes"]),
                    bool(session["recording"]),
                )
                for session in self._json("sessions", TIMEOUT_S)["sessions"]
            ]

    @contextmanager
    def _answers(self) -> Iterator[None]:
        """What breaks the connection, or is not what a voltwall answers, is a FetchFailed."""
        try:
            yield
        except (OSError, http.client.HTTPException) as error:
            raise FetchFailed(self.url, reason_of(error)) from error
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            raise FetchFailed(self.url, Message("no-voltwall")) from error

    def local_id(self, session: RemoteSession) -> str:
        """Return the id that a session of it has here."""
        return self.label_of(session.id)

    def label_of(self, session_id: str) -> str:
        """Return the name that the session of this id has here."""
        return f"{self.label}-{session_id}"

    def is_fetched(self, session: RemoteSession, folder: Path) -> bool:
        """Return whether it was fetched as it is there."""
        path, note = self._paths(session, folder)
        try:
            return path.is_file() and not session.is_recording and int(note.read_text()) == session.size_bytes
        except (OSError, ValueError):
            return False

    def fetch(
        self,
        session: RemoteSession,
        folder: Path,
        on_progress: Progress = lambda done, of: None,
        read_info: Callable[[Path], SessionInfo] = read_info,
    ) -> Path:
        """Bring one session here and return its file; what an earlier attempt brought is not fetched again.

        `read_info` says what a session's file says.

        Raises:
            FetchFailed: the connection broke again and again, or the bytes are not those that the other side has. What
                came is kept for the next time, unless it is wrong. Or another session of this name is here.
        """
        try:
            _session_id(session.id)
        except ValueError as error:
            raise FetchFailed(self.url, Message("bad-session-name", name=repr(session.id[:40]))) from error
        path, note = self._paths(session, folder)
        part = path.with_name(path.name + ".part")
        folder.mkdir(parents=True, exist_ok=True)
        idle = 0
        while True:
            before = _size(part)
            try:
                expected = self._continue(session, part, on_progress)
                break
            except urllib.error.HTTPError as error:
                raise self._failed(session, message_of(error)) from error
            except (OSError, http.client.HTTPException) as error:
                idle = idle + 1 if _size(part) <= before else 0
                if idle >= ATTEMPTS:
                    raise self._failed(session, Message("goes-on-from-here", error=reason_of(error))) from error
                self._sleep(PAUSE_S * 2**idle)
            except ValueError as error:  # a length or a digest that is none
                raise self._failed(session, Message("no-voltwall")) from error
        with part.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").digest()
        if expected is not None and digest != expected:
            part.unlink()
            raise self._failed(session, Message("not-what-was-sent"))
        try:
            began_ns = read_info(part).started_mono_ns
        except (SessionError, LimitExceeded, WorkerEnded) as error:
            part.unlink()
            raise self._failed(session, message_of(error)) from error
        if _is_another(path, began_ns, read_info):
            raise self._failed(session, Message("label-taken"))
        for suffix in ("-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)
        part.replace(path)
        _etag_of(part).unlink(missing_ok=True)
        note.write_text(str(session.size_bytes))
        return path

    def offers(self) -> list[dict[str, Any]]:
        """Return the newest sessions of which it gives pieces: `id`, `pieces`, `bytes`, `recording`.

        Raises:
            FetchFailed: it does not answer, or not as a voltwall that does this.
        """
        with self._answers():
            return [
                {"id": _session_id(offer["id"]), "pieces": _n_pieces(offer["pieces"]), "bytes": int(offer["bytes"]),
                 "started": float(offer["started"]), "recording": bool(offer["recording"])}
                for offer in self._json("pieces")["sessions"]
            ]  # fmt: skip

    def head(self, session_id: str) -> dict[str, Any]:
        """Return metadata of a session.

        Raises:
            FetchFailed: it does not answer, or not as a voltwall that does this.
        """
        with self._answers():
            answer: dict[str, Any] = self._json(f"sessions/{_session_id(session_id)}/head")
            if not isinstance(answer, dict) or any(
                not isinstance(answer.get(key), kind) for key, kind in _HEAD.items()
            ):
                raise ValueError(session_id)
            return answer | {"pieces": _n_pieces(answer["pieces"])}

    def pieces(self, session_id: str, first: int, count: int, *, descending: bool) -> Iterator[tuple[int, str, bytes]]:
        """Yield number, SHA-256 and bytes of pieces as they come, from `first` up or down.

        Raises:
            FetchFailed: it does not answer, or not as it should; what came is good all the same.
        """
        order = "true" if descending else "false"
        path = f"sessions/{_session_id(session_id)}/pieces?first={first}&count={count}&descending={order}"
        with self._answers(), self._open(path, {}, PIECES_TIMEOUT_S) as answer:
            while line := answer.readline(1000):
                header = parse_object(line)
                size = int(header["bytes"])
                if not 0 <= size <= LIST_BYTES:
                    raise ValueError(size)
                body = answer.read(size)
                if len(body) < size:
                    raise FetchFailed(self.url, Message("cut-off"))
                yield int(header["piece"]), str(header["sha256"]), body

    def _json(self, path: str, timeout_s: float = PIECES_TIMEOUT_S) -> Any:
        with self._open(path, {}, timeout_s) as answer:
            return _list_json(self._whole(answer))

    def _whole(self, answer: Any) -> bytes:
        """Read an answer to its end.

        Raises:
            FetchFailed: it takes too long; each byte alone may come in time.
            ValueError: it is too long.
        """
        until_s = self._monotonic_s() + LIST_S
        body = bytearray()
        while piece := answer.read1(PIECE_BYTES):
            body += piece
            if len(body) > LIST_BYTES:
                raise ValueError(len(body))
            if self._monotonic_s() > until_s:
                raise FetchFailed(self.url, Message("answer-too-slow", seconds=LIST_S))
        return bytes(body)

    def _failed(self, session: RemoteSession, reason: Text) -> FetchFailed:
        return FetchFailed(self.url, Message("of-source", source=session.id, reason=reason))

    def _paths(self, session: RemoteSession, folder: Path) -> tuple[Path, Path]:
        path = folder / f"{self.local_id(session)}{SUFFIX}"
        return path, path.with_name(path.name + FETCHED)

    def _continue(self, session: RemoteSession, part: Path, on_progress: Progress) -> bytes | None:
        """Fetch what is missing; return the digest that the whole must have."""
        have, etag = _size(part), _etag_of(part)
        headers = {}
        if have and etag.is_file():
            headers = {"Range": f"bytes={have}-", "If-Range": etag.read_text()}
        try:
            answer = self._open(f"sessions/{session.id}/file", headers)
        except urllib.error.HTTPError as error:
            if error.code != 416:
                raise
            answer = self._open(f"sessions/{session.id}/file", {})  # all of it is here, or more than there is
        with answer:
            start = have if answer.status == 206 else 0
            total = start + int(answer.headers.get("Content-Length", 0))
            etag.write_text(answer.headers.get("ETag", ""))
            with part.open("ab" if start else "wb") as file:
                _copy(answer, file, start, total, on_progress)
            if _size(part) < total:
                raise ConnectionError("the connection ended early")
            return _digest(answer.headers.get("Repr-Digest", ""))

    def _open(self, path: str, headers: dict[str, str], timeout_s: float = TIMEOUT_S) -> Any:
        request = urllib.request.Request(f"{self.url}/api/v1/{path}", headers=headers)
        if self._password is not None:
            request.add_header("Authorization", "Basic " + base64.b64encode(f":{self._password}".encode()).decode())
        return self._opener.open(request, timeout=timeout_s)


def _copy(answer: Any, file: IO[bytes], start: int, total: int, on_progress: Progress) -> None:
    done = start
    while piece := answer.read(PIECE_BYTES):
        file.write(piece)
        done += len(piece)
        on_progress(done, total)


def _n_pieces(answer: object) -> int:
    """How many pieces a session has.

    Raises:
        ValueError: it cannot have so many.
    """
    if not isinstance(answer, int) or not 0 <= answer <= MOST_PIECES:
        raise ValueError(answer)
    return answer


def _session_id(answer: object) -> str:
    """A session's name, which is a part of a path on both sides.

    Raises:
        ValueError: it can be none.
    """
    if not isinstance(answer, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,80}", answer):
        raise ValueError(answer)
    return answer


def _is_another(path: Path, began_ns: int, read_info: Callable[[Path], SessionInfo]) -> bool:
    """Whether a session here began at another moment of its recorder's clock; one that is broken makes room."""
    try:
        return path.is_file() and read_info(path).started_mono_ns != began_ns
    except (SessionError, LimitExceeded):
        return False


def _list_json(answer: bytes) -> Any:
    """Parse an answer in which metadata of sessions are."""
    return parse_json(answer, most_bytes=LIST_BYTES, most_depth=MOST_DEPTH + 4)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _etag_of(part: Path) -> Path:
    return part.with_name(part.name + ".etag")


def _digest(header: str) -> bytes | None:
    """Return the SHA-256 out of a Repr-Digest header (RFC 9530)."""
    match = re.search(r"sha-256=:([A-Za-z0-9+/=]+):", header)
    return base64.b64decode(match[1], validate=True) if match else None
