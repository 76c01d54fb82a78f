"""Deletes old sessions, only where somebody asked for it by age or by size."""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

from app.clock import Clock
from app.errors import AppError
from app.sessions.catalogue import Catalogue
from app.words import Message, Quantity

log = logging.getLogger(__name__)
EVERY_S = 600.0


@dataclass(frozen=True, slots=True)
class RetentionRule:
    """What may stay; None is no limit."""

    keep_days: float | None = None
    keep_gb: float | None = None

    @property
    def deletes(self) -> bool:
        """Whether anything is ever deleted."""
        return self.keep_days is not None or self.keep_gb is not None


def apply_rule(
    catalogue: Catalogue, rule: RetentionRule, now_ns: int, on_deleted: Callable[[Message], None]
) -> tuple[str, ...]:
    """Delete what the rule no longer keeps and return the ids; what is in use stays until the next time."""
    gone: list[str] = []
    if not rule.deletes:
        return ()
    expired = catalogue.expired(
        now_ns,
        older_than_s=None if rule.keep_days is None else rule.keep_days * 86400,
        keep_bytes=None if rule.keep_gb is None else round(rule.keep_gb * 1e9),
    )
    for info in expired:
        try:
            catalogue.delete(info.id)
        except AppError as error:
            log.info("session %s is kept for now: %s", info.id, error)
        else:
            gone.append(info.id)
            size = Quantity(info.size_bytes / 1e6, "MB", 0)
            on_deleted(Message("session-expired", name=info.name, session=info.id, size=size))
    return tuple(gone)


class Retention:
    """Applies a rule at the start and every ten minutes, in a thread of its own; without a rule there is none."""

    def __init__(
        self, catalogue: Catalogue, rule: RetentionRule, on_deleted: Callable[[Message], None], clock: Clock
    ) -> None:
        self._clock = clock
        self._catalogue = catalogue
        self._rule = rule
        self._on_deleted = on_deleted
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
            apply_rule(self._catalogue, self._rule, self._clock.wall_ns(), self._on_deleted)
            if self._ending.wait(EVERY_S):
                return
