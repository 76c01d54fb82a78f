"""candump's text, as `-L` writes it to files and as it stands on a terminal: frames with their times."""

import re
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

from firmware_protocol.memory_map import CAN_ID_EXTENDED

ERROR_FRAME, REMOTE = 0x20000000, "R"
_LINE = re.compile(
    r"\s*\((?P<time>[^)]+)\)\s+\S+\s+(?:[TR]X\s+(?:[-BE]\s+)*)?(?P<id>[0-9A-Fa-f]{3,8})"
    r"(?:#(?P<flags>#[0-9A-Fa-f])?(?P<data>R\d?|(?:[0-9A-Fa-f]{2}\.?){0,64})(?:_[0-9A-Fa-f])?(?:\s+[RT])?"
    r"|\s+\[\s*(?P<length>\d+)\]\s*(?P<bytes>(?:[0-9A-Fa-f]{2}\s*){0,64}|remote request.*)(?:'.*)?)\s*$"
)
_SHORT_ID = 3  # digits of an 11-bit id
MOST_S = 9e9  # in the year 2255; ns since 1970 are kept in 64 bits


class NotCandump(ValueError):
    """A line that is none of candump's."""


def candump_frames(lines: Iterable[str]) -> Iterator[tuple[float, int, bytes]]:
    """Yield time [s], id with bit 31 for 29-bit ones, and data of each data frame.

    Raises:
        NotCandump: a line is none of candump's; the last one may have been cut off.
    """
    broken: str | None = None
    is_candump = False
    for line in lines:
        if broken is not None:
            raise NotCandump(broken)
        found = _LINE.match(line)
        if found is None:
            broken = line.strip()[:60] or None
            if broken is not None and not is_candump:
                raise NotCandump(broken)
            continue
        is_candump = True
        can_id, text = int(found["id"], 16), found["bytes"] if found["data"] is None else found["data"]
        if text.startswith((REMOTE, "remote")) or (len(found["id"]) > _SHORT_ID and can_id & ERROR_FRAME):
            continue
        extended = CAN_ID_EXTENDED if len(found["id"]) > _SHORT_ID else 0
        yield _seconds(found["time"]), can_id & 0x1FFFFFFF | extended, bytes.fromhex(text.replace(".", ""))


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        pass
    else:
        if abs(seconds) < MOST_S:
            return seconds
        raise NotCandump(text)
    try:
        return datetime.fromisoformat(text.strip()).replace(tzinfo=UTC).timestamp()
    except ValueError as error:
        raise NotCandump(text) from error
