"""Sign-ins, refusals and changes of accounts, in the signed log.

A guesser writes no log full: refusals are kept once a minute, with how many there were.
"""

import threading
from contextlib import AbstractContextManager

from app.clock import Clock
from app.configuration.history import ConfigHistory
from app.configuration.write_log import Note, WriteLog
from app.service.settings import Settings
from app.telemetry import Severity
from app.words import Message

REFUSALS_EACH_S = 60.0


class LoginLog:
    """Thread-safe."""

    def __init__(self, log: WriteLog, note: Note, clock: Clock) -> None:
        self._log = log
        self._note = note
        self._clock = clock
        self._lock = threading.Lock()
        self._refused = 0  # since the last record
        self._logged_s: float | None = None

    def changed(self, who: str, what: str) -> AbstractContextManager[None]:
        """Keep the intent to change accounts, tokens or log-ins, then what became of what is done within.

        Raises:
            RecordingFailed: the log does not take it; nothing was done.
        """
        return self._log.signed(who, "access", what)

    def account_changed(self, who: str, name: str) -> None:
        """Tell whose account changed, by the event log that everybody sees: whom nobody asked sees it, too."""
        self._note("warning", "account-changed", Message("account-changed", name=name), who)

    def came_in(self, who: str, role: str, address: str) -> None:
        """Somebody's password was right."""
        self._log.note(who, "login", f"{role}, from {address}")

    def refused(self, who: str | None, address: str) -> None:
        """A password was wrong, or there were too many; `who` where somebody of that name has an account.

        Any other name is kept nowhere: it may be a password in the wrong field.
        """
        now = self._clock.monotonic_s()
        with self._lock:
            self._refused += 1
            if self._logged_s is not None and now - self._logged_s < REFUSALS_EACH_S:
                return
            many, self._refused, self._logged_s = self._refused, 0, now
        name = "?" if who is None else who
        self._note("warning", "login-refused", Message("login-refused", count=many, name=name, address=address))
        self._log.note(name, "login", f"from {address}", f"refused: {many} since the record before")


def _no_event(severity: Severity, code: str, message: Message, who: str | None = None) -> None:
    """There is no event log without a car."""


def log_without_car(settings: Settings, clock: Clock) -> LoginLog:
    """Return the log of a service that shows other cars."""
    return LoginLog(WriteLog(ConfigHistory(settings.data), _no_event, clock), _no_event, clock)
