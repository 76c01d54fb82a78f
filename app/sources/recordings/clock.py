"""The clock of a recording, in the order of its rows: started again, put back, set while logging, past midnight.

Pure numbers. Rows and frames keep their order; what the clock did is a note with the row, and the parts follow each
other one usual step apart. Tables and logs use the same clock.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.sources.recordings.quantities import UNIX_FROM_S
from app.words import Message

SET_FORWARD_S = 365 * 86_400.0  # a step of more is a clock that is set while it logs, no pause
LATE_ROWS = 5  # a stamp this many rows late is a row out of place; more is a clock that started again
LATE_FRAMES_S = 1.0  # frames of several buses come so much out of order
DAY_S, HOUR_S = 86_400.0, 3600.0
BACKWARD_LIMIT = 0.05  # share of backward steps from which a column is no time
STEPPED_SHARE = 0.5  # more rows with the stamp of the one before: the clock counts in steps
REPEATED_S = 1e-6  # between rows of one stamp
BLOCK = 10_000  # frames whose times are taken together
FEWEST_DIFFERENCES = 50  # frames before stamps are called differences
MOST_FRAMES_PER_S = 20_000.0  # more fit on no bus
FEWEST_TOO_FAST = 1000  # frames: a burst is none
CHANGES_NAMED = 5
STEPS_COUNTED = 200  # before a change, for the usual step
NOTHING_AHEAD = np.zeros(0)
Frame = tuple[float, int, bytes]


class Rows(NamedTuple):
    """The rows of a table in the order of time."""

    order: NDArray[np.intp]  # (k,) rows that have a time
    time_s: FloatArray  # (k,) never falling
    started_unix_s: float | None  # None: the stamps count from a start


class Clock:
    """Stamps in, times out that do not jump; one block after the other."""

    def __init__(self, place_of: Callable[[int], Message], late_s: float = 0.0) -> None:
        """Begin before the first stamp.

        Args:
            place_of: names the place in the file of a stamp, by how many came before it.
            late_s: how far a stamp may lie before the newest one without being a step back.
        """
        self._place_of, self._late_s = place_of, late_s
        self._offset_s = 0.0
        self._newest_s = -np.inf  # stamp of this part
        self._step_s = 0.0  # between two stamps, before a change
        self._rows = 0
        self._shift_s = 0.0  # from the first times to real ones, where the clock was set later
        self.notes: list[Message] = []

    def times_s(self, stamps_s: FloatArray, ahead_s: FloatArray = NOTHING_AHEAD) -> FloatArray:
        """Return the (n,) times of the next stamps.

        Args:
            stamps_s: (n,) finite stamps in the order of the file [s].
            ahead_s: (m,) those that follow, as far as they are read [s].
        """
        n, seen = len(stamps_s), 0
        if not n:
            return stamps_s
        stamps_s = np.append(stamps_s, ahead_s)
        if self._newest_s == -np.inf:
            self._newest_s = float(stamps_s[0])
        steps = np.diff(stamps_s[:n], prepend=self._newest_s)
        moves_s = np.zeros(n)
        for k in np.flatnonzero((steps < -self._late_s) | (steps > SET_FORWARD_S)).tolist():
            self._newest_s = float(np.max(stamps_s[seen:k], initial=self._newest_s))
            seen, now_s = k, float(stamps_s[k])
            is_back = now_s < self._newest_s - self._late_s
            following_s = stamps_s[k + 1 : k + 1 + LATE_ROWS]
            is_late = is_back and (len(following_s) < LATE_ROWS or bool(np.any(following_s >= self._newest_s)))
            if is_late or not (is_back or now_s > self._newest_s + SET_FORWARD_S):
                continue
            self._step_s = _usual_step_s(stamps_s[max(0, k - STEPS_COUNTED) : k], self._step_s)
            moves_s[k] = self._change(now_s, self._rows + k)
            self._newest_s = now_s
        times_s = stamps_s[:n] + self._offset_s + np.cumsum(moves_s)
        self._newest_s = float(np.max(stamps_s[seen:n], initial=self._newest_s))
        self._step_s = _usual_step_s(stamps_s[max(0, n - STEPS_COUNTED) : n], self._step_s)
        self._offset_s += float(np.sum(moves_s))
        self._rows += n
        return times_s

    def started_unix_s(self, first_s: float) -> float | None:
        """Return when the first time, `first_s`, was; None: the stamps count from a start."""
        start_s = first_s + self._shift_s
        return start_s if start_s > UNIX_FROM_S else None

    def _change(self, now_s: float, row: int) -> float:
        """Return by how much later times are to be moved [s], and note why.

        Args:
            now_s: the stamp that does not follow the newest one.
            row: how many stamps came before it.
        """
        back_s, place = self._newest_s - now_s, self._place_of(row)
        if DAY_S - HOUR_S < self._newest_s <= DAY_S and 0.0 <= now_s < HOUR_S:
            self._note(Message("clock-midnight", place=place))
            return DAY_S
        if back_s > 0.0:
            self._note(Message("clock-back", place=place, seconds=f"{back_s:.6g}"))
        else:
            self._shift_s -= back_s + self._step_s
            self._note(Message("clock-set", place=place))
        return back_s + self._step_s

    def _note(self, note: Message) -> None:
        if len(self.notes) < CHANGES_NAMED:
            self.notes.append(note)


def _usual_step_s(stamps_s: FloatArray, otherwise_s: float) -> float:
    """Return the median of the steps that are above zero."""
    steps = np.diff(stamps_s)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if len(steps) else otherwise_s


def rows_in_time(source: str, stamps_s: FloatArray, notes: list[Message]) -> Rows:
    """Return the rows of a table in the order of time; rows without a stamp are left out.

    Args:
        source: name of the file, for the error.
        stamps_s: (n,) stamps in the order of the table [s]; NaN where there is none.
        notes: gets what was done.

    Raises:
        ImportFailed: no row has a stamp, or time runs backwards too often to be a time.
    """
    rows: NDArray[np.intp] = np.flatnonzero(np.isfinite(stamps_s))
    if not len(rows):
        raise ImportFailed(source, Message("no-row-has-time"))
    if len(rows) < len(stamps_s):
        notes.append(Message("rows-without-time", left=len(stamps_s) - len(rows), rows=len(stamps_s)))
    steps = np.diff(stamps_s[rows])
    back = int(np.sum(steps < 0.0))
    if back >= 0.9 * max(int(np.count_nonzero(steps)), 1):
        notes.append(Message("rows-reversed"))
        rows = rows[::-1]
        back = int(np.sum(np.diff(stamps_s[rows]) < 0.0))
    if back > max(BACKWARD_LIMIT * len(rows), 1):
        raise ImportFailed(source, Message("time-backwards", back=back, rows=len(rows)))
    clock = Clock(lambda before: Message("row-n", n=int(rows[before]) + 1))
    time_s = clock.times_s(stamps_s[rows])
    notes += clock.notes
    if np.any(np.diff(time_s) < 0.0):
        notes.append(Message("rows-sorted"))
    in_order = np.argsort(time_s, kind="stable")
    time_s = time_s[in_order]
    return Rows(rows[in_order], time_s, clock.started_unix_s(float(time_s[0])))


def own_times(time_s: FloatArray, notes: list[Message]) -> FloatArray:
    """Return (n,) times, never falling, in which each row has its own.

    A clock that counts in steps, with most rows within one, is spread over its steps; else rows of one stamp, as before
    and after a step of the current, follow each other by a microsecond.
    """
    same = np.diff(time_s) == 0.0
    if not same.any():
        return time_s
    stamps_s, first, count = np.unique(time_s, return_index=True, return_counts=True)
    place = np.arange(len(time_s)) - np.repeat(first, count)
    if len(stamps_s) > 1 and np.mean(same) > STEPPED_SHARE:
        usual_s = float(np.median(np.diff(stamps_s)))
        width_s: FloatArray = np.append(np.minimum(np.diff(stamps_s), usual_s), usual_s)
        notes.append(Message("clock-in-steps", seconds=f"{usual_s:.6g}"))
        widths_s: FloatArray = np.repeat(width_s / count, count)
        return time_s + widths_s * place
    notes.append(Message("stamps-repeated", rows=int(np.sum(same))))
    return np.maximum.accumulate(time_s + place * REPEATED_S)


class LogClock:
    """The clock of a log of frames; its reader sets what the format is."""

    def __init__(self) -> None:
        """Begin before the first frame."""
        self.may_be_differences = False  # the format can have the time since the frame before in place of a time
        self.has_lines = False  # each frame is a line, apart from `lines_left_out`
        self.lines_left_out: list[int] = []  # how many frames came before each line that holds none
        self._clock = Clock(self._place_of, LATE_FRAMES_S)
        self.notes = self._clock.notes

    def in_time(self, source: str, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Yield the frames of a log with times that do not jump; late ones by up to a second stay so.

        Raises:
            ImportFailed: there are more frames a second than fit on a bus.
        """
        n, first_s, last_s = 0, float("inf"), float("-inf")
        sum_s: float | None = None
        for block, ahead in _blocks(frames):
            stamps_s = np.array([frame[0] for frame in block])
            ahead_s = np.array([frame[0] for frame in ahead])
            if not n and self.may_be_differences and _are_differences(stamps_s):
                sum_s = 0.0
                self.notes.append(Message("stamps-are-differences"))
            if sum_s is not None:
                stamps_s, ahead_s = sum_s + np.cumsum(stamps_s), NOTHING_AHEAD
                sum_s = float(stamps_s[-1])
            times_s = self._clock.times_s(stamps_s, ahead_s)
            n, first_s, last_s = n + len(block), min(first_s, float(times_s.min())), max(last_s, float(times_s.max()))
            for time_s, (_, can_id, data) in zip(times_s.tolist(), block, strict=True):
                yield time_s, can_id, data
        if n >= FEWEST_TOO_FAST and n > MOST_FRAMES_PER_S * (last_s - first_s):
            raise ImportFailed(source, Message("log-too-fast", frames=n, seconds=f"{last_s - first_s:.3g}"))

    def started_unix_s(self, first_s: float) -> float | None:
        """Return when the first frame, at the time `first_s`, came; None: the log gives no date."""
        return self._clock.started_unix_s(first_s)

    def _place_of(self, before: int) -> Message:
        if not self.has_lines:
            return Message("frame-n", n=before + 1)
        return Message("line-n", n=before + 1 + bisect_right(self.lines_left_out, before))


def _blocks(frames: Iterable[Frame]) -> Iterator[tuple[list[Frame], list[Frame]]]:
    """Yield the frames in blocks, each with the first ones of the next."""
    block: list[Frame] = []
    for frame in frames:
        block.append(frame)
        if len(block) == BLOCK + LATE_ROWS:
            yield block[:BLOCK], block[BLOCK:]
            block = block[BLOCK:]
    if block:
        yield block, []


def _are_differences(stamps_s: FloatArray) -> bool:
    """Return whether stamps, the first ones of a log, are times since the frame before."""
    if len(stamps_s) < FEWEST_DIFFERENCES or stamps_s[0] > 1.0 or np.any(stamps_s < 0.0):
        return False
    return float(np.median(stamps_s)) < LATE_FRAMES_S and float(np.mean(np.diff(stamps_s) < 0.0)) > 0.1
