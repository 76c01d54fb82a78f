"""A session in pieces of ten seconds, as they travel over a link on which no whole file arrives.

A piece holds every row of its stretch of time with the number of its first frame, so that pieces that are put together
tell whether a frame is missing or twice. The recording service makes pieces of its file; the other one checks them.
"""

import base64
import binascii
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import orjson

from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile
from app.sessions.storage.chunks import encode_estimate
from app.sessions.storage.queries import StoredSession

PIECE_NS = 10 * 10**9
SETTLED_NS = 2 * 10**9  # the newest rows of a session that is being recorded may still be in the recorder's memory
COUNTED = ("frames", "can_frames")  # tables whose rows are numbered through the session
MOST_BYTES = 64 << 20  # bytes of a piece, unpacked; the fullest stream is below 1 MB
_ALWAYS_NS = 1 << 62
_COLUMNS = {  # columns and types of each table: integer, string, bytes; upper case: or none
    "frames": ("t_mono_ns, t_wall_ns, link, ok, raw", "iiiib"),
    "can_frames": ("t_mono_ns, t_wall_ns, can_id | (bus << 29), data", "iiib"),  # as older versions send and take it
    "measurements": ("t_mono_ns, t_wall_ns, numbers", "iib"),
    "configs": ("t_mono_ns, t_wall_ns, why, image", "iisb"),
    "markers": ("t_mono_ns, t_wall_ns, kind, text, who", "iissS"),
    "events": (
        "t_mono_ns, t_wall_ns, severity, code, text, cell, value, limit_value, unit, who, message",
        "iisssIFFsSS",
    ),
    "clock": ("t_mono_ns, t_wall_ns, uptime_ms", "iiI"),
    "estimates": ("", "iibb"),
}
_KINDS: Mapping[str, tuple[type, ...]] = {"i": (int,), "s": (str,), "f": (int, float)}
Row = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class SessionPiece:
    """The rows of a piece by table, and the id of the first row of each of COUNTED, also where it has none."""

    first_ids: Mapping[str, int]
    rows: Mapping[str, list[Row]]

    @property
    def ids(self) -> tuple[int, int, int, int]:
        """First id and the one after the last, of frames, then of CAN frames."""
        frames, can = (self.first_ids[table] for table in COUNTED)
        return frames, frames + len(self.rows["frames"]), can, can + len(self.rows["can_frames"])


def n_pieces(info: SessionInfo, *, is_recording: bool) -> int:
    """Return the number of pieces of a session whose rows are all on the disk; of a finished one all."""
    length_ns = (info.ended_mono_ns or info.started_mono_ns) - info.started_mono_ns
    return max(0, (length_ns - SETTLED_NS) // PIECE_NS) if is_recording else length_ns // PIECE_NS + 1


def read_piece(session: SessionFile, stored: StoredSession, info: SessionInfo, number: int, *, is_last: bool) -> bytes:
    """Return a piece of a session as it travels; the first and the last one hold what lies before and behind, too."""
    first_ns = info.started_mono_ns + number * PIECE_NS
    end_ns = first_ns + PIECE_NS
    t_from_s, t_to_s = session.unix_s(first_ns), session.unix_s(end_ns)
    low_ns, high_ns = -_ALWAYS_NS if number == 0 else first_ns, _ALWAYS_NS if is_last else end_ns
    body: dict[str, Any] = {}
    first_ids = {}
    for table, (columns, kinds) in _COLUMNS.items():
        if table in COUNTED:
            first_ids[table], rows = stored.rows_between(table, columns, low_ns, high_ns)
        elif table == "estimates":
            estimates = session.estimates(None if number == 0 else t_from_s, None if is_last else t_to_s)
            rows = [(t, up, encode_estimate(soc), encode_estimate(sigma)) for t, up, soc, sigma in estimates]
            rows = [row for row in rows if low_ns <= row[0] < high_ns]
        else:
            where = "t_mono_ns >= ? AND t_mono_ns < ?"
            rows = stored.rows(f"SELECT {columns} FROM {table} WHERE {where} ORDER BY id", (low_ns, high_ns))
        body[table] = [
            [base64.b64encode(v).decode() if kind == "b" else v for kind, v in zip(kinds, row, strict=True)]
            for row in rows
        ]
    return zlib.compress(orjson.dumps({"first_ids": first_ids, **body}))


def parse_piece(body: bytes) -> SessionPiece:
    """Return what a piece holds.

    Raises:
        ValueError: it is none; not a single value of it is used.
    """
    try:
        unpacker = zlib.decompressobj()
        document = json.loads(unpacker.decompress(body, MOST_BYTES))
        if unpacker.unconsumed_tail or not unpacker.eof:
            raise ValueError("it is longer than a piece can be, or cut off")
        first_ids = {table: _checked("i", document["first_ids"][table]) for table in COUNTED}
        rows = {
            table: [tuple(_checked(k, v) for k, v in zip(kinds, row, strict=True)) for row in document[table]]
            for table, (_, kinds) in _COLUMNS.items()
            if table in document or table != "measurements"  # which older versions do not send
        }
        rows["can_frames"] = [
            (*t, can_id & ~(3 << 29), data, can_id >> 29 & 3) for *t, can_id, data in rows["can_frames"]
        ]
    except (zlib.error, KeyError, TypeError, RecursionError, binascii.Error) as error:
        raise ValueError(f"no piece of a session: {error}") from error
    return SessionPiece(first_ids, rows)


def _checked(kind: str, value: object) -> Any:
    if kind.isupper() and value is None:
        return None
    kind = kind.lower()
    if kind == "b":
        if not isinstance(value, str):
            raise ValueError("bytes are sent as base64")
        return base64.b64decode(value, validate=True)
    if not isinstance(value, _KINDS[kind]) or isinstance(value, bool):
        raise ValueError(f"{str(value)[:40]!r} where {kind} is expected")  # noqa: TRY004
    if isinstance(value, int) and abs(value) >= 1 << 63:
        raise ValueError(f"{str(value)[:40]} does not fit 64 bits")
    return value


def head_of(session: SessionFile, info: SessionInfo, *, is_recording: bool) -> dict[str, Any]:
    """Metadata of a session, as it is sent."""
    return {
        "id": info.id,
        "name": info.name,
        "voltwall": info.voltwall,
        "map_hash": info.map_hash,
        "metadata": dict(info.metadata),
        "start_mono_ns": info.started_mono_ns,
        "start_wall_ns": info.started_wall_ns,
        "end_mono_ns": info.ended_mono_ns,
        "end_wall_ns": info.ended_wall_ns,
        "closed": info.is_closed,
        "recording": is_recording,
        "pieces": n_pieces(info, is_recording=is_recording),
        "bytes": info.size_bytes,
        "frames": info.frames,
        "can_frames": info.can_frames,
        "cell_file": session.cell_file,
        "battery_files": [
            [name, base64.b64encode(data).decode()]
            for name, data in (
                session.loaded_battery.files.items() if not session.loaded_battery.has_memory_map else ()
            )
        ],
    }
