"""The schedule of the master's stream: parts of the struct, and the time of a frame on the line; C sends them.

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
