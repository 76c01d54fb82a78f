"""Limits of open connections, in total and from one address, and which one makes room for another.

Descriptors are kept for what must never wait for a stranger: links, recorder, databases.
"""

import logging
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

KEPT_ASIDE = 256  # descriptors: links, session files, databases, and what is accepted before it is counted
MOST = 4096
FEWEST = 16
CROWD = 64
ACCEPTED_AT_ONCE = 32  # by the event loop, before the first of them is counted
log = logging.getLogger(__name__)


class Connection(Protocol):
    """One open connection."""

    address: str
    is_websocket: bool

    def shutdown(self) -> None:
        """End it where nobody else does."""

    def cut(self) -> None:
        """End it at once, and take it out of the connections it is counted in."""


@dataclass(slots=True)
class _Group:
    """All connections, or those of one address."""

    total: int = 0
    websockets: int = 0
    waiting: OrderedDict[Connection, None] = field(default_factory=OrderedDict)  # the longest first

    def cut_longest(self) -> bool:
        longest = next(iter(self.waiting), None)
        if longest is not None:
            longest.cut()
        return longest is not None


class ClientConnections:
    """The connections of a server, counted: at most `most`, half of them from one address.

    Each operation takes the same time however many there are: a flood makes thousands a second. `on_crowd_gone` is
    called when CROWD or more were open and three quarters of them have left.
    """

    def __init__(self, most: int = MOST, on_crowd_gone: Callable[[], None] = lambda: None) -> None:
        self._limit = most
        self._on_crowd_gone = on_crowd_gone
        self._peak = 0  # since a crowd was gone
        self._all = _Group()
        self._by_address: dict[str, _Group] = {}
        self._open: dict[Connection, tuple[_Group, _Group]] = {}

    def __iter__(self) -> Iterator[Connection]:
        return iter(list(self._open))

    def __len__(self) -> int:
        return len(self._open)

    def add(self, connection: Connection) -> bool:
        """Count it, as one whose client has to send something, or return False; one that waits longest makes room.

        Half of all connections are an address's own: a flood from one leaves the rest to the others.
        """
        own = self._by_address.get(connection.address) or _Group()
        if own.total >= self._limit // 2:
            has_room = own.cut_longest()
        else:
            has_room = len(self) < self._limit - 1 or self._all.cut_longest()
        if not has_room:
            log.warning("refused a connection of %s: too many are open", connection.address)
            return False
        own = self._by_address.setdefault(connection.address, own)
        self._open[connection] = (self._all, own)
        for group in (self._all, own):
            group.total += 1
        self.start_waiting(connection)
        self._peak = max(self._peak, len(self))
        return True

    def upgrade(self, connection: Connection) -> bool:
        """Count it as a websocket, or return False: a quarter stays for plain requests, of all and of an address."""
        groups = self._open.get(connection, ())
        limits = (self._limit * 3 // 4, self._limit // 2 * 3 // 4)
        if not groups or any(group.websockets >= most for group, most in zip(groups, limits, strict=True)):
            log.warning("refused a websocket of %s: too many are open", connection.address)
            return False
        self.stop_waiting(connection)
        connection.is_websocket = True
        for group in groups:
            group.websockets += 1
        return True

    def discard(self, connection: Connection) -> None:
        """Count it no more."""
        self.stop_waiting(connection)
        groups = self._open.pop(connection, ())
        for group in groups:
            group.total -= 1
            group.websockets -= connection.is_websocket
        if groups and not groups[1].total:
            del self._by_address[connection.address]
        if self._peak >= CROWD and len(self) < self._peak // 4:
            self._peak = len(self)
            self._on_crowd_gone()

    def start_waiting(self, connection: Connection) -> None:
        """Let it make room for another, after those that wait already: from now on its client has to send something."""
        for group in self._open.get(connection, ()):
            group.waiting[connection] = None
            group.waiting.move_to_end(connection)

    def stop_waiting(self, connection: Connection) -> None:
        """Keep it: what its client asked for is worked on."""
        for group in self._open.get(connection, ()):
            group.waiting.pop(connection, None)


def most_connections(descriptors: int | None) -> int:
    """Return how many connections the system's descriptors allow; `descriptors` None = the system has no limit."""
    if descriptors is None:
        return MOST
    return max(FEWEST, min(MOST, descriptors - KEPT_ASIDE, descriptors * 3 // 4))
