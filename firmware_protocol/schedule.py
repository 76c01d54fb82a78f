"""Which parts of the struct the master's stream sends, and when. Pure: time is an argument.

The fast set leaves every `telemetry_period` in one DATA frame. The slow ranges go round in pieces, one DATA frame each,
cut to what the line has left before the next fast frame; a full turn starts no oftener than once a second.
"""

from firmware_protocol.framing import LINE_BYTES_PER_S, OVERHEAD
from firmware_protocol.memory_map import CONFIG_SIZE, FIELDS

Span = tuple[int, int]  # offset, length

FAST_WINDOWS: tuple[Span, ...] = (
    (420, 20),  # status, charger
    (1884, 204),  # i_fs, i_fc, i_fc_hp, v
    (2280, 116),  # v_min to dod, with all of t
    (2982, 2),  # soc
)
SLOW_RANGES: tuple[Span, ...] = (
    (0, CONFIG_SIZE),
    (440, 1444),  # n_slaves, slave[8]
    (FIELDS["ocv"].offset, FIELDS["ocv"].size),
    (2396, 586),  # c, c_min to c_max_id, r_fs, r_fc
)
SLOW_LENGTH = 200  # at most, of one piece
SLOW_LENGTH_WORTHWHILE = 32  # a shorter piece is sent only where it ends its range
ALIGNMENT = 4  # pieces are cut where no number of the struct is split
SLOW_TURN_S = 1.0
FAST_PER_SLOW = 20  # where the period leaves no room at all, one piece follows this many fast frames all the same
_WINDOW_HEADER = 4
_DELIMITERS = 2


def frame_bytes(body_length: int) -> int:
    """Return the most bytes that a frame with such a body takes on the line, both delimiters included."""
    payload = OVERHEAD + body_length
    return payload + (payload + 253) // 254 + _DELIMITERS


def frame_time_s(n_bytes: int) -> float:
    """Return how long so many bytes take on the line [s]."""
    return n_bytes / LINE_BYTES_PER_S


def data_frame_time_s(spans: tuple[Span, ...]) -> float:
    """Return how long a DATA frame with these windows takes on the line at most [s]."""
    return frame_time_s(frame_bytes(sum(_WINDOW_HEADER + length for _, length in spans)))


class StreamSchedule:
    """Chooses the content of the next stream frame whenever the line is free. Created when the stream starts."""

    def __init__(self, period_s: float, now_s: float) -> None:
        self.period_s = period_s
        self._fast_s = now_s
        self._turn_s = now_s  # when the next slow turn may start
        self._range = 0
        self._sent_of_range = 0
        self._fast_in_a_row = 0

    def due_s(self, now_s: float) -> float:
        """Return when `take` has something, on a line that is free from `now_s` on; never before `now_s`."""
        fast_s = max(now_s, self._fast_s)
        slow_s = max(now_s, self._slow_from_s())
        return min(fast_s, slow_s) if self._slow_length(slow_s) else fast_s

    def take(self, now_s: float) -> tuple[Span, ...] | None:
        """Return the windows of the frame to be sent now, None while nothing is due."""
        if now_s >= self._slow_from_s() and (length := self._slow_length(now_s)):
            return (self._take_slow(length, now_s),)
        if now_s >= self._fast_s:
            self._fast_s = max(self._fast_s + self.period_s, now_s)
            self._fast_in_a_row += 1
            return FAST_WINDOWS
        return None

    def _slow_from_s(self) -> float:
        return self._turn_s if self._range == 0 and self._sent_of_range == 0 else 0.0

    def _slow_length(self, at_s: float) -> int:
        """Return the length of the piece that may be sent at a time, 0 for none."""
        left = SLOW_RANGES[self._range][1] - self._sent_of_range
        if self._fast_in_a_row >= FAST_PER_SLOW:
            room = SLOW_LENGTH
        else:
            room = min(SLOW_LENGTH, int((self._fast_s - at_s) * LINE_BYTES_PER_S) - frame_bytes(_WINDOW_HEADER))
        if left <= room:
            return left
        return room // ALIGNMENT * ALIGNMENT if room >= SLOW_LENGTH_WORTHWHILE else 0

    def _take_slow(self, length: int, now_s: float) -> Span:
        offset, range_length = SLOW_RANGES[self._range]
        if self._range == 0 and self._sent_of_range == 0:
            self._turn_s = now_s + SLOW_TURN_S
        span = offset + self._sent_of_range, length
        self._sent_of_range += length
        if self._sent_of_range == range_length:
            self._range = (self._range + 1) % len(SLOW_RANGES)
            self._sent_of_range = 0
        self._fast_in_a_row = 0
        return span
