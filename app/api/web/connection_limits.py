"""How many connections the service holds, in all and from one address, and which one makes room for another.

Descriptors are kept aside for what must never wait for a stranger: links, recorder, databases.
"""

import logging
from collections.abc import Collection
from typing import Protocol

KEPT_ASIDE = 256  # descriptors: links, session files, databases, and what is accepted before it is counted
MOST = 4096
FEWEST = 16
ACCEPTED_AT_ONCE = 32  # by the event loop, before the first of them is counted
log = logging.getLogger(__name__)


class Connection(Protocol):
    """What is known of an open connection."""

    client: tuple[str, int] | None
    is_websocket: bool
    waits_since_s: float | None  # for a request; None while one is worked on

    def cut(self) -> None:
        """End it at once."""


def most_connections(descriptors: int | None) -> int:
    """Return how many connections fit beside what is kept aside; `descriptors` None = the system has no limit."""
    if descriptors is None:
        return MOST
    return max(FEWEST, min(MOST, descriptors - KEPT_ASIDE, descriptors * 3 // 4))


def make_room(connections: Collection[Connection], address: str, most: int) -> bool:
    """Tell whether one more from `address` may come in; the one that waits longest for a request makes room.

    An address has half of all connections: a flood from one leaves the rest to the others.
    """
    own = [each for each in connections if _address(each) == address]
    if len(own) >= most // 2:
        return _cut_longest(own)
    if len(connections) >= most - 1:
        return _cut_longest(connections)
    return True


def may_upgrade(connections: Collection[Connection], address: str, most: int) -> bool:
    """Tell whether another websocket may be opened: a quarter stays for plain requests, in all and of an address."""
    open_ones = [each for each in connections if each.is_websocket]
    own = sum(_address(each) == address for each in open_ones)
    return len(open_ones) < most * 3 // 4 and own < most // 2 * 3 // 4


def refuse(address: str, what: str) -> None:
    """Log a refusal."""
    log.warning("refused %s of %s: too many are open", what, address)


def _address(connection: Connection) -> str:
    return "" if connection.client is None else connection.client[0]


def _cut_longest(connections: Collection[Connection]) -> bool:
    waiting = [each for each in connections if each.waits_since_s is not None]
    if not waiting:
        return False
    min(waiting, key=lambda each: each.waits_since_s or 0.0).cut()
    return True
