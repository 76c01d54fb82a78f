"""Deletes old sessions, only where somebody asked for it by age or by size.

Age is what a clock says, and clocks are wrong: on a Raspberry Pi without a battery, after a summer, in a test. So a
session is deleted by age only where the clock goes with the sessions, it lies in a trash folder for a while first, and
a clock that is suddenly ahead takes but a part of them, with a warning.
"""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from app.clock import Clock
from app.errors import AppError, message_of
from app.sessions.catalogue import Catalogue
from app.sessions.info import SessionInfo
from app.sources.data_file import encodable
from app.telemetry import Severity
from app.words import Message, Quantity

log = logging.getLogger(__name__)
Note = Callable[[Severity, Message], None]
EVERY_S = 600.0
AGREES_NS = 14 * 86_400 * 10**9  # the newest session is no older than this, by a clock that nobody sets
BEHIND_NS = 3600 * 10**9  # or the clock is behind what was recorded last
SHARE = 4  # at most one in so many goes in one run
FEWEST = 2
NAMED = 10  # files in one warning
TRASH_NS = 7 * 86_400 * 10**9
FREE_BYTES = 2 << 30  # with less left the trash is emptied at once


@dataclass(frozen=True, slots=True)
class RetentionRule:
    """Limits of the recordings that stay; None is no limit."""

    keep_days: float | None = None
    keep_gb: float | None = None

    @property
    def deletes(self) -> bool:
        """Return whether anything is ever deleted."""
        return self.keep_days is not None or self.keep_gb is not None


def clock_problem(catalogue: Catalogue, now_ns: int, *, is_set_by_others: bool) -> Message | None:
    """Return why sessions are not deleted by this clock; None where it can be trusted.

    Args:
        catalogue: of the sessions.
        now_ns: what the clock shows.
        is_set_by_others: the network, or another clock, keeps it right.
    """
    newest = max((info.ended_wall_ns or info.started_wall_ns for info in catalogue.list()), default=None)
    if newest is None:
        return None
    days = Quantity(abs(now_ns - newest) / 86_400e9, "d", 0)
    if now_ns < newest - BEHIND_NS:
        return Message("retention-clock-behind", time=days)
    if not is_set_by_others and now_ns - newest > AGREES_NS:
        return Message("retention-clock-ahead", time=days)
    return None


def apply_rule(catalogue: Catalogue, rule: RetentionRule, now_ns: int, note: Note, *, by_age: bool = True) -> list[str]:
    """Delete what the rule no longer keeps and return the ids; what is in use stays until the next time.

    Args:
        catalogue: of the sessions.
        rule: what stays.
        now_ns: the clock.
        note: called for each, with its severity.
        by_age: the clock is trusted.
    """
    gone: list[str] = []
    if rule.keep_gb is not None:
        for info in catalogue.expired(now_ns, keep_bytes=round(rule.keep_gb * 1e9)):
            gone += _take(info, catalogue.delete, note)
    if rule.keep_days is None or not by_age:
        return gone
    old = catalogue.expired(now_ns, older_than_s=rule.keep_days * 86400)
    most = max(FEWEST, len(catalogue.list()) // SHARE)
    if len(old) > most:
        note("warning", Message("retention-much", n=len(old), most=most))
    for info in old[:most]:
        gone += _take(info, catalogue.discard, note)
    return gone


def _take(info: SessionInfo, away: Callable[[str], None], note: Note) -> list[str]:
    try:
        away(info.id)
    except (AppError, OSError) as error:
        log.info("session %s is kept for now: %s", info.id, error)
        return []
    size = Quantity(info.size_bytes / 1e6, "MB", 0)
    note("info", Message("session-expired", name=info.name, session=info.id, size=size))
    return [info.id]


class Retention:
    """Applies a rule at the start and every ten minutes, in a thread of its own; without a rule there is none."""

    def __init__(
        self,
        catalogue: Catalogue,
        rule: RetentionRule,
        note: Note,
        clock: Clock,
        is_clock_set: Callable[[], bool] = lambda: False,
    ) -> None:
        """Prepare the thread; `is_clock_set` tells whether the network, or another clock, keeps ours right."""
        self._is_clock_set = is_clock_set
        self._problem: str | None = None
        self._unjudged: set[str] = set()  # files that were named
        self._failure: str | None = None
        self._clock = clock
        self._catalogue = catalogue
        self._rule = rule
        self._note = note
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="retention", daemon=True)

    def start(self) -> None:
        """Begin."""
        if self._rule.deletes:
            self._thread.start()

    def stop(self) -> None:
        """End, after the deletion under way."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            self.apply()
            if self._ending.wait(EVERY_S):
                return

    def apply(self) -> None:
        """Apply the rule once; whatever goes wrong is noted, once as long as it is the same."""
        failure = None
        try:
            self._name_unjudged()
            self._apply_rule()
        except Exception as error:  # the disk refused something; the thread goes on
            log.exception("old sessions are not deleted")
            failure = Message("retention-failed", error=message_of(error))
        if failure is not None and str(failure) != self._failure:
            self._note("warning", failure)
        self._failure = None if failure is None else str(failure)

    def _name_unjudged(self) -> None:
        """Note the files that cannot be read, each once."""
        unjudged = {Path(problem.path).name for problem in self._catalogue.survey()[1]}
        if new := sorted(unjudged - self._unjudged):
            self._note("warning", Message("retention-unjudged", n=len(new), files=tuple(map(encodable, new[:NAMED]))))
        self._unjudged = unjudged

    def _apply_rule(self) -> None:
        now_ns = self._clock.wall_ns()
        problem = None
        if self._rule.keep_days is not None:
            problem = clock_problem(self._catalogue, now_ns, is_set_by_others=self._is_clock_set())
        if problem is not None and problem.code != self._problem:
            self._note("warning", problem)
        self._problem = None if problem is None else problem.code
        apply_rule(self._catalogue, self._rule, now_ns, self._note, by_age=problem is None)
        if problem is None:
            self._catalogue.empty_trash(now_ns - TRASH_NS, FREE_BYTES)
