"""An ordinary BMS's protection: limits with persistence, latched, within the times of FS rules EV 5.8.7."""

from collections.abc import Iterable
from typing import NamedTuple

from firmware_protocol.messages import EventCode
from simulator.bms_state import Latch

FAST_PERSISTENCE_S = 0.3
SLOW_PERSISTENCE_S = 0.4
WIRE_PERSISTENCE_S = 0.5  # a lost measurement has no time in the rules
SENSOR_PERSISTENCE_S = 1.0  # of a temperature


class Violation(NamedTuple):
    """A value beyond its limit, or a measurement that is missing."""

    code: EventCode
    persistence_s: float


class Protection:
    """The OK signal: switched off by a violation that persists, stays off until cleared."""

    def __init__(self, latch: Latch) -> None:
        self._latch = latch
        self._since_s: dict[EventCode, float] = {}

    @property
    def is_ok(self) -> bool:
        """The OK signal."""
        return not self._latch.is_open

    def judge(self, found: Iterable[Violation], now_s: float) -> None:
        """Take this pass's violations."""
        critical = tuple(found)
        self._since_s = {each.code: self._since_s.get(each.code, now_s) for each in critical}
        for code, persistence_s in critical:
            # a microsecond of slack: times are sums of steps
            if now_s - self._since_s[code] >= persistence_s - 1e-6:
                self._latch.is_open = True

    def clear(self) -> bool:
        """Release the latch unless a limit is violated now; return whether it was released."""
        if not self._since_s:
            self._latch.is_open = False
        return not self._since_s
