"""CAN logs of text, a frame a line: candump (of a file and of a terminal), SavvyCAN's CSV (GVRET), OVMS' CRTD."""

import re
from datetime import UTC, datetime

from app.sources.recordings.bad_rows import SHOWN_TEXT, UnreadableLine
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

Frame = tuple[float, int, bytes, str]  # and the bus, as the log names it
SAVVYCAN_HEADER = re.compile(r"\ufeff?\s*Time\s*Stamp\s*,\s*ID\s*,\s*Extended\s*,", re.IGNORECASE)
CRTD_LINE = re.compile(
    r"(?P<time>\d+(?:\.\d+)?)\s+(?P<bus>\d*)(?:(?P<way>[RT])(?P<bits>11|29)\s+(?P<id>[0-9A-Fa-f]{1,8})"
    r"(?P<data>(?:\s+[0-9A-Fa-f]{2}){0,64})|C[A-Z]{2}\b.*|[TR]?[EX]\w*\b.*)\s*$"
)
_SAVVYCAN = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,.."
_SHORT_ID = 0x7FF
_ID_BITS = 0x1FFFFFFF


def savvycan_frame(line: str) -> Frame | None:
    """Return the frame of a line of SavvyCAN's own CSV: `Time Stamp,ID,Extended,Dir,Bus,LEN,D1,...`, time in us.

    Raises:
        UnreadableLine: it is no such line; says what was expected.
    """
    if SAVVYCAN_HEADER.match(line):
        return None
    fields = [field.strip() for field in line.strip().split(",")]
    first_byte = 6 if len(fields) > 5 and fields[3][:1].lower() in "rt" else 5  # files of before 2017 have no Dir
    if len(fields) < first_byte:
        raise UnreadableLine(Message("line-unlike", shape=_SAVVYCAN, text=line.strip()[:SHOWN_TEXT]))
    try:
        time_us, can_id, length = float(fields[0]), int(fields[1], 16), int(fields[first_byte - 1])
        data = bytes(int(byte, 16) for byte in fields[first_byte : first_byte + length])
    except ValueError as error:
        raise UnreadableLine(Message("line-unlike", shape=_SAVVYCAN, text=line.strip()[:SHOWN_TEXT])) from error
    if len(data) != length:
        raise UnreadableLine(Message("line-cut", id=fields[1][:SHOWN_TEXT], bytes=len(data), length=length))
    if can_id > _ID_BITS:
        raise UnreadableLine(Message("line-id", id=fields[1][:SHOWN_TEXT], bits=29))
    is_extended = fields[2].lower() in ("true", "1") or can_id > _SHORT_ID
    bus = fields[first_byte - 2]
    return time_us * 1e-6, can_id | (CAN_ID_EXTENDED if is_extended else 0), data, bus


def crtd_frame(line: str) -> Frame | None:
    """Return the frame of a line of a CRTD log: `1705316400.05 3R11 131 00 00`; None for remarks and events.

    Raises:
        UnreadableLine: it is no such line; says what was expected.
    """
    if line.lstrip().startswith("#"):
        return None
    match = CRTD_LINE.match(line.strip())
    if match is None:
        raise UnreadableLine(Message("line-unlike", shape="TIME R11|R29 ID BYTES", text=line.strip()[:SHOWN_TEXT]))
    if match["way"] is None:
        return None
    extended = CAN_ID_EXTENDED if match["bits"] == "29" else 0
    can_id = int(match["id"], 16)
    if can_id > (_ID_BITS if extended else _SHORT_ID):
        raise UnreadableLine(Message("line-id", id=match["id"], bits=int(match["bits"])))
    return float(match["time"]), can_id | extended, bytes.fromhex(match["data"]), match["bus"]


ERROR_FRAME, REMOTE = 0x20000000, "R"
CANDUMP_LINE = re.compile(
    r"\s*\((?P<time>[^)]+)\)\s+(?P<bus>\S+)\s+(?:[TR]X\s+(?:[-BE]\s+)*)?(?P<id>[0-9A-Fa-f]{1,8})"
    r"(?:#(?P<flags>#[0-9A-Fa-f])?(?P<data>R\d?|(?:[0-9A-Fa-f]{2}\.?){0,64})(?:_[0-9A-Fa-f])?(?:\s+[RT])?"
    r"|\s+\[\s*(?P<length>\d{1,3})\]\s*+(?P<bytes>(?:[0-9A-Fa-f]{2}\s*+){0,64}+|remote request.*)(?:'.*)?)\s*$"
)
CANDUMP_WITHOUT_TIME = re.compile(r"\s*\w+\s+[0-9A-Fa-f]{3,8}\s+\[\d{1,2}\](?:\s+[0-9A-Fa-f]{2}){0,64}\s*$")
_PLAIN = re.compile(r"\((\d{1,10}\.\d+)\) (\S+) ([0-9A-F]{3})#((?:[0-9A-F]{2}){0,8})\n")  # nearly all of them
_SHORT_ID_DIGITS = 3  # digits of an 11-bit id
MOST_S = 9e9  # in the year 2255; ns since 1970 are kept in 64 bits


def candump_frame(line: str) -> Frame | None:
    """Return time [s], id with bit 31 for 29-bit ones, data and bus of a line; None for remote and error frames.

    Raises:
        UnreadableLine: the line is none of candump's.
    """
    plain = _PLAIN.fullmatch(line)
    if plain is not None and (seconds := float(plain[1])) < MOST_S:
        return seconds, int(plain[3], 16), bytes.fromhex(plain[4]), plain[2]
    match = CANDUMP_LINE.match(line)
    if match is None:
        raise UnreadableLine(Message("line-unlike", shape="(TIME) BUS ID#BYTES", text=line.strip()[:SHOWN_TEXT]))
    can_id, text = int(match["id"], 16), match["bytes"] if match["data"] is None else match["data"]
    if text.startswith((REMOTE, "remote")) or (len(match["id"]) > _SHORT_ID_DIGITS and can_id & ERROR_FRAME):
        return None
    extended = CAN_ID_EXTENDED if len(match["id"]) > _SHORT_ID_DIGITS else 0
    data = bytes.fromhex(text.replace(".", ""))
    return _seconds(match["time"]), can_id & 0x1FFFFFFF | extended, data, match["bus"]


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
