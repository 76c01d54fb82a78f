"""Load shedding so that recording keeps up: measured by the recorder's own delay, never by the machine's load.

The order is fixed: predictions and findings first, which nobody misses for seconds; then pages, which get one snapshot
a second. The estimator takes every sample; one that falls behind delays no recording (see `Inbox`).

Recording is first in processor time, never in waiting. A slow or stalled disk is no lack of processor time: while the
items do not wait for the pipeline's thread, nothing is left out, however long frames wait for the disk.
"""

import logging
import time
from collections.abc import Callable
from enum import IntEnum

from app.clock import Clock
from app.words import Message, Quantity

log = logging.getLogger(__name__)
BOUND_S = 0.4  # from a frame's arrival to its commit; 0.5 s is what a kill may cost
DELAY_OK_S = 0.35  # below this, and while the processor is not short, it takes back the last step
STEP_DOWN_S = 0.5  # between two steps down
STEP_UP_S = 5.0  # between two steps back; twice as long each time that one had to be taken again
STEP_UP_MAX_S = 80.0
LATE_S = 0.1  # items that wait this long for the pipeline's thread: the processor is short
SMOOTHED_S = 0.5  # over so long: a single late item is no lack
SHED_AFTER_S = 0.2  # to a commit
PAUSE_S = 0.1  # after an item, at most


class ShedLoad(IntEnum):
    """Work that is left out; each with all before it."""

    NOTHING = 0
    PREDICTION = 1
    PAGES = 2


class LoadShedding:
    """Asked by the pipeline's thread with each item; `problem` by any."""

    def __init__(
        self,
        delay_s: Callable[[], float | None],
        clock: Clock,
        wait_for_commit: Callable[[float], None],
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        """Watch `delay_s`: how long the last frames took to be committed; None while nothing is, or the disk stalls.

        `wait_for_commit` returns when the commit that is due is done, or after so many seconds, once for each commit.
        """
        self._delay_s = delay_s
        self._wait_for_commit = wait_for_commit
        self._pause = pause
        self._clock = clock
        self._shed = ShedLoad.NOTHING
        self._changed_s = clock.monotonic_s()
        self._easier_s = STEP_UP_S
        self._eased_s: float | None = None  # when the last step back was
        self._waited_s, self._asked_s = 0.0, self._changed_s
        self._short_s = self._changed_s  # when the processor last was

    def now(self, waited_s: float) -> ShedLoad:
        """Return what to leave out, after the next item has waited so long for the pipeline's thread."""
        delay_s, now_s = self._delay_s() or 0.0, self._clock.monotonic_s()
        before, since_s = self._shed, now_s - self._changed_s
        self._waited_s += (waited_s - self._waited_s) * min((now_s - self._asked_s) / SMOOTHED_S, 1.0)
        self._asked_s = now_s
        is_short = self._waited_s > LATE_S
        if is_short:
            self._short_s = now_s
        if is_short and delay_s > BOUND_S and before < ShedLoad.PAGES and since_s >= STEP_DOWN_S:
            self._shed = ShedLoad(before + 1)
            if self._eased_s is not None:
                is_soon = now_s - self._eased_s < STEP_UP_MAX_S
                self._easier_s = min(2 * self._easier_s, STEP_UP_MAX_S) if is_soon else STEP_UP_S
                self._eased_s = None
        elif (
            delay_s < DELAY_OK_S and before > ShedLoad.NOTHING and min(since_s, now_s - self._short_s) >= self._easier_s
        ):
            self._shed = ShedLoad(before - 1)
            self._eased_s = now_s
        if self._shed != before:
            self._changed_s = now_s
            log.warning("write latency %.2f s, load shedding: %s", delay_s, self._shed.name.lower())
        return self._shed

    def shed(self, took_s: float) -> None:
        """Let recording go first where something is left out: it shares processor and interpreter with the caller.

        A commit that is due, and then for as long as the caller's last item took: half of the time at most is its own.
        """
        if self._shed > ShedLoad.NOTHING:
            self._wait_for_commit(SHED_AFTER_S)
            self._pause(min(took_s, PAUSE_S))

    @property
    def problem(self) -> Message | None:
        """Return the message about work that is left out; None while nothing is."""
        if self._shed == ShedLoad.NOTHING:
            return None
        delay = Quantity(self._delay_s() or 0.0, "s", 2)
        if self._shed == ShedLoad.PREDICTION:
            return Message("shed-prediction", delay=delay)
        return Message("shed-pages", delay=delay)
