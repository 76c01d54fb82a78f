"""candump's text, as `-L` writes it to files and as it stands on a terminal: frames with their times."""

import re
from datetime import UTC, datetime

from app.sources.recordings.bad_rows import SHOWN_TEXT, UnreadableLine
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

ERROR_FRAME, REMOTE = 0x20000000, "R"
CANDUMP_LINE = re.compile(
    r"\s*\((?P<time>[^)]+)\)\s+\S+\s+(?:[TR]X\s+(?:[-BE]\s+)*)?(?P<id>[0-9A-Fa-f]{3,8})"
    r"(?:#(?P<flags>#[0-9A-Fa-f])?(?P<data>R\d?|(?:[0-9A-Fa-f]{2}\.?){0,64})(?:_[0-9A-Fa-f])?(?:\s+[RT])?"
    r"|\s+\[\s*(?P<length>\d{1,3})\]\s*+(?P<bytes>(?:[0-9A-Fa-f]{2}\s*+){0,64}+|remote request.*)(?:'.*)?)\s*$"
)
_PLAIN = re.compile(r"\((\d{1,10}\.\d+)\) \S+ ([0-9A-F]{3})#((?:[0-9A-F]{2}){0,8})\n")  # nearly all of them
_SHORT_ID = 3  # digits of an 11-bit id
MOST_S = 9e9  # in the year 2255; ns since 1970 are kept in 64 bits


def candump_frame(line: str) -> tuple[float, int, bytes] | None:
    """Return time [s], id with bit 31 for 29-bit ones, and data of a line; None for remote and error frames.

    Raises:
        UnreadableLine: the line is none of candump's.
    """
    plain = _PLAIN.fullmatch(line)
    if plain is not None and (seconds := float(plain[1])) < MOST_S:
        return seconds, int(plain[2], 16), bytes.fromhex(plain[3])
    found = CANDUMP_LINE.match(line)
    if found is None:
        raise UnreadableLine(Message("line-unlike", shape="(TIME) BUS ID#BYTES", text=line.strip()[:SHOWN_TEXT]))
    can_id, text = int(found["id"], 16), found["bytes"] if found["data"] is None else found["data"]
    if text.startswith((REMOTE, "remote")) or (len(found["id"]) > _SHORT_ID and can_id & ERROR_FRAME):
        return None
    extended = CAN_ID_EXTENDED if len(found["id"]) > _SHORT_ID else 0
    return _seconds(found["time"]), can_id & 0x1FFFFFFF | extended, bytes.fromhex(text.replace(".", ""))


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        pass
    else:
        if abs(seconds) < MOST_S:
            return seconds
        raise UnreadableLine(Message("line-no-time", text=text[:SHOWN_TEXT]))
    try:
        return datetime.fromisoformat(text.strip()).replace(tzinfo=UTC).timestamp()
    except ValueError as error:
        raise UnreadableLine(Message("line-no-time", text=text[:SHOWN_TEXT])) from error
