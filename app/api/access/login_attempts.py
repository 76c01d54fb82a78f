"""Limits of wrong passwords: a guesser is slowed, the right person is locked out nowhere else.

Three bounds, each for one address alone: tries of a minute; fewer where the account is guessed at from many addresses;
and, of an hour, tries at one account, after which each has to wait for the one before.
"""

import threading
from dataclasses import dataclass, field
from ipaddress import ip_address, ip_network

from app.clock import Clock

MOST_KEPT = 10_000  # sources, accounts, and pairs of them
MINUTE_S, HOUR_S = 60.0, 3600.0
PER_MINUTE = 10  # from a source
ATTACKED_AFTER = 50  # failures on one account in an hour, from anywhere: each source has FEW a minute then
FEW = 2
PER_HOUR = 10  # from a source on one account; then one each WAIT_S, which makes 70 at most
WAIT_S = 60.0
Key = str | tuple[str, str]


@dataclass
class LoginAttempts:
    """Times of failed tries; thread-safe. Accounts by name, "" for every name that is no person's."""

    clock: Clock
    _failures: dict[Key, list[float]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def begin(self, account: str, address: str) -> float:
        """Count a try as a failure before it is checked, so that tries at once count as well.

        Returns:
            0, or after how many seconds the next one is allowed: this one must not be checked.
        """
        now, source = self.clock.monotonic_s(), source_of(address)
        pair = source, account
        with self._lock:
            minute, hour = self._since(source, now - MINUTE_S), self._since(pair, now - HOUR_S)
            on_account = self._since(f"account {account}", now - HOUR_S)
            if len(minute) >= (PER_MINUTE if len(on_account) < ATTACKED_AFTER else FEW):
                return MINUTE_S
            if len(hour) >= PER_HOUR and now - hour[-1] < WAIT_S:
                return WAIT_S
            self._keep(source, [*minute, now])
            self._keep(pair, [*hour, now])
        return 0.0

    def failed(self, account: str) -> None:
        """The try was wrong."""
        now = self.clock.monotonic_s()
        with self._lock:
            on_account = self._since(f"account {account}", now - HOUR_S)
            self._keep(f"account {account}", [*on_account[-ATTACKED_AFTER:], now])

    def right(self, account: str, address: str, *, forgets: bool) -> None:
        """The try was right: it counts no more, with `forgets` nor do those before it."""
        source = source_of(address)
        with self._lock:
            for key in (source, (source, account)):
                if forgets:
                    self._failures.pop(key, None)
                elif times := self._failures.get(key):
                    times.pop()

    def _since(self, key: Key, start_s: float) -> list[float]:
        return [t for t in self._failures.get(key, []) if t > start_s]

    def _keep(self, key: Key, times: list[float]) -> None:
        """Keep times; the oldest key leaves first."""
        self._failures.pop(key, None)
        self._failures[key] = times
        while len(self._failures) > MOST_KEPT:
            self._failures.pop(next(iter(self._failures)))


def source_of(address: str) -> str:
    """Return the address that counts as one guesser: an IPv4 address, or an IPv6 network of 2^64 addresses."""
    try:
        parsed = ip_address(address)
    except ValueError:
        return address
    return address if parsed.version == 4 else str(ip_network((parsed, 64), strict=False))
