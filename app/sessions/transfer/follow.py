"""Keeps copies of a recorder's sessions over a link that breaks, also of the one being recorded.

What is missing is fetched piece by piece whenever the link allows, and after what is shown live.
"""

import threading
import urllib.error
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from app.clock import Clock
from app.errors import AppError, ConfigError, message_of
from app.sessions.catalogue import Catalogue
from app.sessions.errors import FetchFailed
from app.sessions.storage.files import FETCHED, SUFFIX
from app.sessions.transfer.fetch import Remote
from app.sessions.transfer.fill import fill_from
from app.sessions.transfer.session_copy import SessionCopy
from app.sessions.transfer.trust import context_for
from app.telemetry.measurement import STALE_S
from app.words import Message, Text

Order = Literal["oldest", "newest"]
LIST_S = 5.0  # twice while a piece of what is being recorded grows
MOST_AT_ONCE = 32  # pieces in one request: a long way costs once, and a cut takes no more than the piece under way
PAUSE_MIN_S, PAUSE_MAX_S = 0.5, 10.0  # after a failure
YIELD_S = 0.2  # the live view is looked at again so soon
MOST_YIELD_S = 3.0  # for each piece: on a radio that is always late, what is missing comes all the same
GONE_S = 10.0  # a live view that is late for longer is gone for another reason
FRESH_PIECES = 30  # a session is made of what is here after so many, or a quarter more than before


@dataclass(frozen=True, slots=True)
class FollowState:
    """State of following one recorder."""

    url: str
    is_reached: bool = False
    error: Text | None = None
    last_contact_s: float | None = None  # unix time of its last answer


class Follower:
    """Follows one recorder. One thread calls `step` or `run`; any thread reads `state`."""

    def __init__(
        self,
        remote: Remote,
        folder: Path,
        clock: Clock,
        order: Order = "oldest",
        live_age_s: Callable[[], float | None] = lambda: None,
        note: Callable[[Message], None] = lambda _: None,
        catalogue: Catalogue | None = None,
    ) -> None:
        """Only keep what is given.

        Args:
            remote: the recorder.
            folder: of the sessions here.
            clock: of this machine.
            order: which of the missing pieces come first, at the start.
            live_age_s: of what is shown live [s]; where it is late, nothing else may use the link.
            note: called for every session that is whole, and of what was filled from it.
            catalogue: of that folder, which says how sessions are read; None: in this process.
        """
        self.remote = remote
        self.state = FollowState(remote.url)
        self._folder = folder
        self._clock = clock
        self.order: Order = order  # from the next stretch on
        self._live_age_s = live_age_s
        self._note = note
        self._catalogue = catalogue or Catalogue(folder)
        self._copies: dict[str, SessionCopy] = {}  # by the recorder's id; those that are not whole
        self._built: dict[str, int] = {}  # pieces in the session that was made last
        self._aside: set[str] = set()  # sessions that were refused: all others come first
        self._listed_s: float | None = None
        self._at_once = 1

    def run(self, ending: threading.Event) -> None:
        """Follow until `ending` is set, whatever happens to the link."""
        pause_s = PAUSE_MIN_S
        while not ending.is_set():
            try:
                has_more = self.step(ending)
            except Exception as error:  # noqa: BLE001  whatever it is, the next attempt goes on from here
                self._at_once = 1
                self._listed_s = None
                reason = error.reason if isinstance(error, FetchFailed) else message_of(error)
                self.state = FollowState(self.remote.url, False, reason, self.state.last_contact_s)
                ending.wait(pause_s)
                pause_s = min(2 * pause_s, PAUSE_MAX_S)
                continue
            pause_s = PAUSE_MIN_S
            if not has_more:
                ending.wait(LIST_S / 4)

    def step(self, ending: threading.Event | None = None) -> bool:
        """Ask for the list where that is due, and for one stretch of pieces; whether anything is still missing.

        Raises:
            FetchFailed: the link broke, or what came is wrong; every piece before that is kept.
        """
        now_s = self._clock.monotonic_s()
        wrong: Exception | None = None
        if self._listed_s is None or now_s - self._listed_s >= LIST_S:
            wrong = self._list()
            self._listed_s = now_s
        chosen = self._choose()
        if chosen is None:
            if wrong is not None:
                raise wrong
            return False
        session_id, copy, first, count, descending = chosen
        try:
            for number, digest, body in self.remote.pieces(session_id, first, count, descending=descending):
                copy.put(number, body, digest)
                self._mark_reachable()
                self._let_live_pass(ending)
                if ending is not None and ending.is_set():
                    return True
        except ValueError as error:
            self._aside.add(session_id)
            raise AppError(Message("piece-refused", session=copy.id, error=str(error))) from error
        except FetchFailed as error:
            if isinstance(error.__cause__, urllib.error.HTTPError):
                self._aside.add(session_id)
            raise
        self._aside.discard(session_id)
        self._at_once = min(2 * self._at_once, MOST_AT_ONCE)
        self._build_if_due(session_id, copy)
        return self._choose() is not None

    def _list(self) -> Exception | None:
        """Ask what there is; return what is wrong with one of the sessions, which keeps no other from coming."""
        offers = self.remote.offers()
        self._mark_reachable()
        wrong: Exception | None = None
        for offer in sorted(offers, key=lambda offer: float(offer["started"]), reverse=self._is_newest_first):
            try:
                self._take_offer(offer)
            except Exception as error:  # noqa: BLE001  of this session; a broken link is met again at the next one
                wrong = wrong or error
        return wrong

    def _take_offer(self, offer: dict[str, Any]) -> None:
        session_id = offer["id"]
        copy = self._copies.get(session_id) or SessionCopy(self._folder, self.remote.label_of(session_id))
        if self._is_here(copy.id, offer):
            self._copies.pop(session_id, None)
            return
        head = copy.head
        if head and head["recording"] and offer["recording"]:
            copy.note_head(head | {"pieces": offer["pieces"]})
        elif not head or head["recording"] or head["bytes"] != offer["bytes"]:
            copy.note_head(self.remote.head(session_id))
        self._copies[session_id] = copy
        self._build_if_due(session_id, copy)

    def _is_here(self, local_id: str, offer: dict[str, Any]) -> bool:
        note = self._folder / f"{local_id}{SUFFIX}{FETCHED}"
        try:
            return not offer["recording"] and int(note.read_text()) == offer["bytes"]
        except (OSError, ValueError):
            return False

    def _choose(self) -> tuple[str, SessionCopy, int, int, bool] | None:
        """Session, its copy, first piece and how many of the stretch that comes next, and whether it goes down."""
        descending = self._is_newest_first
        copies = sorted(self._copies.items(), key=lambda item: int(item[1].head["start_wall_ns"]), reverse=descending)
        copies.sort(key=lambda item: item[0] in self._aside)
        for session_id, copy in copies:
            missing = copy.missing()
            if missing:
                first, last = missing[-1] if descending else missing[0]
                count = min(last - first + 1, self._at_once)
                return session_id, copy, last if descending else first, count, descending
        return None

    def _build_if_due(self, session_id: str, copy: SessionCopy) -> None:
        here = len(copy.have())
        if copy.is_whole():
            path = copy.build(self._catalogue.parse)
            self._copies.pop(session_id, None)
            self._note(Message("session-fetched", session=copy.id, url=self.remote.url))
            for message in fill_from(self._catalogue, path, t_wall_ns=self._clock.wall_ns()):
                self._note(message)
        elif here - self._built.get(session_id, 0) >= max(FRESH_PIECES, self._built.get(session_id, 0) // 4):
            copy.build(self._catalogue.parse)
            self._built[session_id] = here

    def _let_live_pass(self, ending: threading.Event | None) -> None:
        waited_s = 0.0
        while self._is_live_late() and waited_s < MOST_YIELD_S:
            (ending or threading.Event()).wait(YIELD_S)
            waited_s += YIELD_S

    def _is_live_late(self) -> bool:
        age_s = self._live_age_s()
        return age_s is not None and STALE_S <= age_s < GONE_S

    @property
    def _is_newest_first(self) -> bool:
        return self.order == "newest"

    def _mark_reachable(self) -> None:
        self.state = FollowState(self.remote.url, True, None, self._clock.wall_ns() / 1e9)


class Followers:
    """All recorders of the settings, each followed in a thread of its own."""

    def __init__(self, followers: Iterable[Follower]) -> None:
        self._followers = tuple(followers)
        self._ending = threading.Event()
        self._threads = [
            threading.Thread(target=follower.run, args=(self._ending,), name="follow", daemon=True)
            for follower in self._followers
        ]

    def start(self) -> None:
        """Begin."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """End, each after the piece under way; one that waits for a broken link is left behind."""
        self._ending.set()
        for thread in self._threads:
            if thread.is_alive():
                thread.join(timeout=1.0)

    @property
    def order(self) -> Order:
        """Return which missing pieces come first, of all recorders."""
        return self._followers[0].order if self._followers else "oldest"

    def choose(self, order: Order) -> None:
        """Let these pieces come first, until the service ends."""
        for follower in self._followers:
            follower.order = order

    def states(self) -> list[FollowState]:
        """Return the state of each."""
        return [follower.state for follower in self._followers]


def remotes_of(setting: str | None, password: str | None, trust: str | None = None) -> list[Remote]:
    """Return the recorders of a setting like `red=http://red.local:8000,http://10.0.0.7:8000`.

    Raises:
        ConfigError: one of them is no URL, its label cannot be one or is another's, or `trust` is no certificate's.
    """
    remotes: list[Remote] = []
    context_for(trust)
    for entry in (setting or "").split(","):
        label, _, url = entry.strip().rpartition("=")
        if not url:
            continue
        try:
            remote = Remote(url, label=label, password=password, trust=trust)
        except ConfigError as error:
            raise ConfigError("recorder", entry.strip(), error.limit) from error
        if any(remote.label == other.label for other in remotes):
            raise ConfigError("recorder", entry.strip(), Message("label-taken"))
        remotes.append(remote)
    return remotes
