"""Brings sessions in from elsewhere: fetched from a recorder in the car, and what they have filled into ours."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from app.clock import Clock
from app.errors import NotNow, message_of
from app.sessions.catalogue import Catalogue
from app.sessions.errors import SessionNotFound
from app.sessions.transfer.fetch import Remote, RemoteSession
from app.sessions.transfer.fill import fill_from
from app.sessions.transfer.session_copy import remove_left_halves
from app.telemetry import Severity
from app.words import Message, Text


@dataclass(frozen=True, slots=True)
class FetchState:
    """Progress of a fetch."""

    url: str
    is_running: bool = True
    session_id: str = ""  # under way, as it is called here
    done_bytes: int = 0
    total_bytes: int = 0
    fetched: tuple[str, ...] = ()  # ids here
    already_here: int = 0
    filled: tuple[Message, ...] = ()
    error: Text | None = None


@dataclass
class Fetch:
    """Fetches what a remote has and this folder has not, and fills gaps from it."""

    remote: Remote
    folder: Path
    catalogue: Catalogue
    clock: Clock
    on_change: Callable[[FetchState], None] = lambda _: None
    state: FetchState = field(init=False)

    def __post_init__(self) -> None:
        self.state = FetchState(self.remote.url)

    def run(self, wanted: Sequence[str] = (), *, fill: bool = True) -> FetchState:
        """Fetch the wanted sessions, or all that are finished there, oldest first.

        Raises:
            FetchFailed: the remote does not answer, or a session did not come over whole.
            SessionNotFound: it has none of this id.
        """
        sessions = {session.id: session for session in self.remote.sessions()}
        for session_id in wanted:
            if session_id not in sessions:
                raise SessionNotFound(session_id)
        chosen = [sessions[i] for i in wanted] if wanted else [s for s in sessions.values() if not s.is_recording]
        chosen.sort(key=lambda session: session.started_s)
        for session in chosen:
            if self.remote.is_fetched(session, self.folder):
                self._change(already_here=self.state.already_here + 1)
            else:
                self._one(session, fill)
        self._change(is_running=False, session_id="")
        return self.state

    def _one(self, session: RemoteSession, fill: bool) -> None:
        local_id = self.remote.local_id(session)
        self._change(session_id=local_id, done_bytes=0, total_bytes=session.size_bytes)
        path = self.remote.fetch(
            session,
            self.folder,
            lambda done, of: self._change(done_bytes=done, total_bytes=of),
            self.catalogue.read_info,
        )
        self._change(fetched=(*self.state.fetched, local_id))
        if fill:
            for message in fill_from(self.catalogue, path, t_wall_ns=self.clock.wall_ns()):
                self._change(filled=(*self.state.filled, message))

    def _change(self, **values: object) -> None:
        self.state = replace(self.state, **values)  # type: ignore[arg-type]
        self.on_change(self.state)


class FetchJobs:
    """One fetch at a time, in a thread of its own, for the service."""

    def __init__(
        self, folder: Path, catalogue: Catalogue, note: Callable[[Severity, str, Message], None], clock: Clock
    ) -> None:
        """Prepare; what an earlier run left half copied for too long is deleted."""
        remove_left_halves(folder, clock.wall_s())
        self._clock = clock
        self._folder = folder
        self._catalogue = catalogue
        self._note = note  # into the event log
        self._lock = threading.Lock()
        self._fetch: Fetch | None = None

    def state(self) -> FetchState | None:
        """Return the progress of the last fetch, None before the first."""
        return None if self._fetch is None else self._fetch.state

    def start(self, remote: Remote, wanted: Sequence[str], *, fill: bool) -> FetchState:
        """Begin to fetch.

        Raises:
            NotNow: another fetch is under way.
        """
        with self._lock:
            if self._fetch is not None and self._fetch.state.is_running:
                raise NotNow(Message("being-fetched", url=self._fetch.state.url))
            self._fetch = fetch = Fetch(remote, self._folder, self._catalogue, self._clock)
        threading.Thread(target=self._run, args=(fetch, tuple(wanted), fill), name="fetch", daemon=True).start()
        return fetch.state

    def _run(self, fetch: Fetch, wanted: tuple[str, ...], fill: bool) -> None:
        try:
            done = fetch.run(wanted, fill=fill)
        except Exception as error:  # noqa: BLE001  whatever it is, the job ends and can be started again
            fetch.state = replace(fetch.state, is_running=False, error=message_of(error))
            self._note("warning", "fetch-failed", Message("fetch-failed", error=message_of(error)))
            return
        for session_id in done.fetched:
            self._note("info", "session-fetched", Message("session-fetched", session=session_id, url=done.url))
        for message in done.filled:
            self._note("info", "gaps-filled", message)
