"""How many connections the service holds, in all and from one address, and which one makes room for another.

Descriptors are kept aside for what must never wait for a stranger: links, recorder, databases.
"""

import logging
from collections import OrderedDict
from collections.abc import Callable, Iterator, MutableSet
from dataclasses import dataclass, field
from typing import Protocol

KEPT_ASIDE = 256  # descriptors: links, session files, databases, and what is accepted before it is counted
MOST = 4096
FEWEST = 16
CROWD = 64
ACCEPTED_AT_ONCE = 32  # by the event loop, before the first of them is counted
log = logging.getLogger(__name__)


class Connection(Protocol):
    """What is known of an open connection."""

    client: tuple[str, int] | None
    is_websocket: bool

    def cut(self) -> None:
        """End it at once, and take it out of the connections it is counted in."""


@dataclass(slots=True)
class _Group:
    """All connections, or those of one address."""

    address: str
    total: int = 0
    websockets: int = 0
    waiting: OrderedDict[Connection, None] = field(default_factory=OrderedDict)  # the longest first


class ClientConnections(MutableSet[Connection]):
    """The connections of a server, counted; `uvicorn.ServerState.connections` is one.

    Each operation takes the same time however many there are: a flood makes thousands a second. `on_crowd_gone` is
    called when CROWD or more were open and three quarters of them have left.
    """

    def __init__(self, on_crowd_gone: Callable[[], None] = lambda: None) -> None:
        self._on_crowd_gone = on_crowd_gone
        self._most = 0  # at once, since a crowd was gone
        self._all = _Group("")
        self._by_address: dict[str, _Group] = {}
        self._group: dict[Connection, _Group] = {}

    def __contains__(self, connection: object) -> bool:
        return connection in self._group

    def __iter__(self) -> Iterator[Connection]:
        return iter(self._group)

    def __len__(self) -> int:
        return len(self._group)

    def add(self, connection: Connection) -> None:
        """Count it, under the address that its `client` has now."""
        if connection in self._group:
            return
        address = "" if connection.client is None else connection.client[0]
        own = self._group[connection] = self._by_address.setdefault(address, _Group(address))
        for group in (self._all, own):
            group.total += 1
            group.websockets += connection.is_websocket
        self._most = max(self._most, len(self))

    def discard(self, connection: Connection) -> None:
        """Count it no more."""
        own = self._group.get(connection)
        if own is None:
            return
        self.stop_waiting(connection)
        del self._group[connection]
        for group in (self._all, own):
            group.total -= 1
            group.websockets -= connection.is_websocket
        if not own.total:
            del self._by_address[own.address]
        if self._most >= CROWD and len(self) < self._most // 4:
            self._most = len(self)
            self._on_crowd_gone()

    def start_waiting(self, connection: Connection) -> None:
        """Let it make room for another, after those that wait already: from now on its client has to send something."""
        if (own := self._group.get(connection)) is not None:
            for group in (self._all, own):
                group.waiting[connection] = None
                group.waiting.move_to_end(connection)

    def stop_waiting(self, connection: Connection) -> None:
        """Keep it: what its client asked for is worked on."""
        if (own := self._group.get(connection)) is not None:
            for group in (self._all, own):
                group.waiting.pop(connection, None)

    def make_room(self, address: str, most: int) -> bool:
        """Return whether one more from `address` may come in; the one that waits longest makes room.

        An address has half of all connections: a flood from one leaves the rest to the others.
        """
        own = self._by_address.get(address)
        if own is not None and own.total >= most // 2:
            return _cut_longest(own)
        if len(self) >= most - 1:
            return _cut_longest(self._all)
        return True

    def may_upgrade(self, address: str, most: int) -> bool:
        """Return whether another websocket may be opened: a quarter stays for plain requests, of all and an address."""
        own = self._by_address.get(address)
        of_address = 0 if own is None else own.websockets
        return self._all.websockets < most * 3 // 4 and of_address < most // 2 * 3 // 4


def most_connections(descriptors: int | None) -> int:
    """Return how many connections fit beside what is kept aside; `descriptors` None = the system has no limit."""
    if descriptors is None:
        return MOST
    return max(FEWEST, min(MOST, descriptors - KEPT_ASIDE, descriptors * 3 // 4))


def refuse(address: str, what: str) -> None:
    """Log a refusal."""
    log.warning("refused %s of %s: too many are open", what, address)


def _cut_longest(group: _Group) -> bool:
    longest = next(iter(group.waiting), None)
    if longest is None:
        return False
    longest.cut()
    return True
