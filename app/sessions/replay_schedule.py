"""The schedule of recorded items. Pure: time comes as an argument, due items go out as a list."""

import math
from collections.abc import Iterator
from heapq import merge
from typing import TYPE_CHECKING, TypeAlias

from app.errors import ConfigError
from app.sessions.info import RecordedCanFrame, RecordedFrame

if TYPE_CHECKING:
    from app.sessions.reading.reader import SessionFile
    from app.sources.items import TableItem

LEAD_S = 5.0  # after a jump, so much from before it comes first: every window of the stream has had its turn
MIN_SPEED, MAX_SPEED = 0.1, 100.0
MIN_LOOP_S = 0.5
MAX_ITEMS = 64  # items at a time; orders are handled in between
Received: TypeAlias = "RecordedFrame | RecordedCanFrame | TableItem"


class Pacer:
    """Plays a session's serial and CAN frames, as received and in order.

    `speed` is 0.1..100 times, or math.inf for as fast as they are taken. Positions are seconds from the start.
    """

    def __init__(self, session: "SessionFile", *, now_s: float, speed: float = 1.0, position_s: float = 0.0) -> None:
        """Begin to play at a position.

        Raises:
            ConfigError: the speed is not one of the possible.
        """
        info = session.info
        self._session = session
        self._start_ns = info.started_mono_ns
        self.duration_s = info.duration_s
        self.speed = _checked(speed)
        self.is_paused = False
        self.loop: tuple[float, float] | None = None  # begins anew at the first when the second is reached
        self._now_s = now_s
        self._at_s = position_s
        self._items: Iterator[Received] = iter(())
        self._next: Received | None = None
        self.seek(position_s, now_s)

    @property
    def is_finished(self) -> bool:
        """Everything has been played."""
        return self._next is None

    def position_s(self, now_s: float) -> float:
        """Return the position in the recording [s]."""
        if self.is_finished:
            return self.duration_s
        if self.is_paused or math.isinf(self.speed):
            return self._at_s
        return min(self._at_s + (now_s - self._now_s) * self.speed, self.duration_s)

    def due(self, now_s: float) -> list[Received]:
        """Return what is to be played by now and has not been, at most MAX_ITEMS.

        Who takes longer to play than the items lie apart plays slower than asked for; nothing is left out.
        """
        received: list[Received] = []
        if self.is_paused:
            return received
        hurries = math.isinf(self.speed)
        position_s = self.position_s(now_s)
        while (item := self._next) is not None:
            if len(received) >= MAX_ITEMS or (not hurries and self._position_of(item) > position_s):
                break
            received.append(item)
            self._next = next(self._items, None)
        if received and (hurries or len(received) >= MAX_ITEMS):
            self._at_s, self._now_s = max(self._at_s, self._position_of(received[-1])), now_s
        return received

    def wait_s(self, now_s: float) -> float | None:
        """Return how long nothing will be due, None while paused or finished."""
        if self._next is None or self.is_paused:
            return None
        if math.isinf(self.speed):
            return 0.0
        return max(0.0, (self._position_of(self._next) - self.position_s(now_s)) / self.speed)

    def step(self) -> list[Received]:
        """Pause and return everything up to and with the next serial frame, or row of a table."""
        self.is_paused = True
        received: list[Received] = []
        while (item := self._next) is not None:
            received.append(item)
            self._next = next(self._items, None)
            self._at_s = max(self._at_s, self._position_of(item))
            if not isinstance(item, RecordedCanFrame):
                break
        return received

    def pause(self, now_s: float) -> None:
        """Stand still."""
        self._hold(now_s)
        self.is_paused = True

    def resume(self, now_s: float) -> None:
        """Go on."""
        self._hold(now_s)
        self.is_paused = False

    def set_speed(self, speed: float, now_s: float) -> None:
        """Go on at another speed.

        Raises:
            ConfigError: it is not one of the possible.
        """
        self._hold(now_s)
        self.speed = _checked(speed)

    def set_loop(self, from_s: float, to_s: float) -> None:
        """Play a stretch again and again.

        Raises:
            ConfigError: it does not lie within the session, or is shorter than MIN_LOOP_S.
        """
        if not (from_s >= 0.0 and from_s + MIN_LOOP_S <= to_s):
            raise ConfigError("loop", [from_s, to_s], f"from 0 on, and at least {MIN_LOOP_S} s long")
        if from_s > self.duration_s - MIN_LOOP_S:
            raise ConfigError("loop", [from_s, to_s], f"within the session's {self.duration_s:.1f} s")
        self.loop = from_s, min(to_s, self.duration_s)

    def is_loop_over(self, now_s: float) -> bool:
        """True where the end of the loop was reached: time to `seek` its beginning."""
        return self.loop is not None and not self.is_paused and self.position_s(now_s) >= self.loop[1]

    def seek(self, position_s: float, now_s: float) -> None:
        """Jump; what was received in the LEAD_S before the position is due at once, the rest in its time."""
        self._at_s = min(max(position_s, 0.0), self.duration_s)
        self._now_s = now_s
        lead_s = self._session.unix_s(self._start_ns + round((self._at_s - LEAD_S) * 1e9)) if self._at_s else None
        session = self._session
        sources: list[Iterator[Received]] = [
            session.frames(lead_s), session.can_frames(lead_s), session.measurements(lead_s)
        ]  # fmt: skip
        self._items = merge(*sources, key=lambda item: item.t_mono_ns)
        self._next = next(self._items, None)

    def _hold(self, now_s: float) -> None:
        self._at_s = self.position_s(now_s)
        self._now_s = now_s

    def _position_of(self, item: Received) -> float:
        return (item.t_mono_ns - self._start_ns) / 1e9


def _checked(speed: float) -> float:
    if not (MIN_SPEED <= speed <= MAX_SPEED or speed == math.inf):
        raise ConfigError("speed", speed, f"{MIN_SPEED}..{MAX_SPEED:.0f}, or infinite for as fast as possible")
    return speed
