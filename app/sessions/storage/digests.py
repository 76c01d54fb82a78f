"""Running digests of what is written into a session, one a table: a bit that changes later on is found by them.

They stand in `meta` under `digests`: {table: [last id, SHA-256 in hex]}, brought up to date with each chunk. What
people settle afterwards (`notes`) and estimates that no chunk has taken over yet are in none.
"""

import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from typing import Any

KEY = "digests"
COLUMNS = {
    "frames": "id, t_mono_ns, t_wall_ns, link, ok, raw",
    "can_frames": "id, t_mono_ns, t_wall_ns, can_id, data, bus",
    "measurements": "id, t_mono_ns, t_wall_ns, numbers",
    "events": "id, t_mono_ns, t_wall_ns, severity, code, text, cell, value, limit_value, unit, who, message",
    "markers": "id, t_mono_ns, t_wall_ns, kind, text, who",
    "configs": "id, t_mono_ns, t_wall_ns, why, image",
    "clock": "id, t_mono_ns, t_wall_ns, uptime_ms",
    "battery_files": "id, name, data",
    "chunks": "id, first_frame, last_frame, bad_frames, first_us, last_us, boots, last_uptime_ms",
    "series": "id, field, first_element, elements, dtype",
    "tracks": "id, samples, times_us, instants",
    "columns": "id, track, ends, data",
}
META = "meta"
_AT_ONCE = 1000  # values and lengths: the hash is given pieces of some size, and no table is in memory
_SHORT = 64
_LENGTHS = [length.to_bytes(4, "little") for length in range(_SHORT)]  # encoded lengths of short values
Row = tuple[Any, ...]


class Digest:
    """Digest of the rows of one table, in the order of their ids."""

    def __init__(self) -> None:
        self.last_id = 0
        self._hash = hashlib.sha256()

    def add(self, row: Sequence[Any]) -> None:
        """Take a row, its id first."""
        self.add_all((row,))

    def add_all(self, rows: Iterable[Sequence[Any]]) -> None:
        """Take rows in order, their ids first; millions of CAN frames pass here."""
        parts: list[bytes] = []
        for row in rows:
            for value in row:
                kind = type(value)
                body = b"i%d" % value if kind is int else b"b" + value if kind is bytes else _packed(value)
                parts.append(_LENGTHS[len(body)] if len(body) < _SHORT else len(body).to_bytes(4, "little"))
                parts.append(body)
            self.last_id = row[0]
            if len(parts) > _AT_ONCE:
                self._hash.update(b"".join(parts))
                parts = []
        self._hash.update(b"".join(parts))

    def copy(self) -> "Digest":
        """Return one that goes on from here."""
        other = Digest()
        other.last_id, other._hash = self.last_id, self._hash.copy()
        return other

    @property
    def value(self) -> tuple[int, str]:
        """Last id and digest."""
        return self.last_id, self._hash.hexdigest()


class Digests:
    """Digests of all tables of a session that is being written."""

    def __init__(self) -> None:
        self._tables = {table: Digest() for table in COLUMNS}
        self._meta: dict[str, str] = {}

    def take(self, table: str, rows: Iterable[Row]) -> None:
        """Take rows as they were handed to the disk, without ids: those count from 1."""
        if table == META:
            self._meta |= dict(rows)
        elif table in self._tables:
            digest = self._tables[table]
            digest.add_all(digested(table, ((number, *row) for number, row in enumerate(rows, digest.last_id + 1))))

    def take_with_ids(self, table: str, rows: Iterable[Row]) -> None:
        """Take rows that bring their ids."""
        self._tables[table].add_all(rows)

    def restart(self, table: str, rows: Iterable[Row]) -> None:
        """Begin anew with a table's rows, ids first."""
        self._tables[table] = Digest()
        self.take_with_ids(table, rows)

    def copy(self) -> "Digests":
        """Return some that go on from here."""
        other = Digests()
        other._tables = {table: digest.copy() for table, digest in self._tables.items()}
        other._meta = self._meta.copy()
        return other

    def text(self) -> str:
        """Return the text that is written into `meta`."""
        digests = {table: digest.value for table, digest in self._tables.items()}
        return json.dumps(digests | {META: meta_digest(self._meta)})


def digested(table: str, rows: Iterable[Row]) -> Iterable[Row]:
    """Return rows, ids first, as their digest takes them: with the bus in bits 29 and 30 of the id, as it once was."""
    if table != "can_frames":
        return rows
    return (
        (number, mono_ns, wall_ns, can_id | bus << 29, data) for number, mono_ns, wall_ns, can_id, data, bus in rows
    )


def meta_digest(meta: dict[str, str]) -> tuple[int, str]:
    """Return how many entries there are and their digest, without that of the digests themselves."""
    digest = Digest()
    for number, (key, value) in enumerate(sorted((key, value) for key, value in meta.items() if key != KEY), 1):
        digest.add((number, key, value))
    return digest.value


def _packed(value: Any) -> bytes:
    """A value as it comes back from SQLite: whole numbers are alike in columns of either kind, NaN is NULL."""
    match value:
        case None:
            return b"n"
        case bytes():
            return b"b" + value
        case str():
            return b"s" + value.encode(errors="surrogatepass")
        case float() if math.isnan(value):
            return b"n"
        case float() if not (value.is_integer() and abs(value) < 1 << 53):
            return b"f" + repr(value).encode()
    return b"i" + str(int(value)).encode()
