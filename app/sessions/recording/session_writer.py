"""One session file being written: rows in transactions, a closed chunk of columns a minute. No thread, no clock."""

import json
import sqlite3
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from app.sessions.info import SessionInfo
from app.sessions.recording.file_watch import FileWatch
from app.sessions.storage.chunks import FOREIGN_CAN, Chunk, ChunkBuilder, SeriesKey, encode_estimate
from app.sessions.storage.database import SESSION, open_for_writing
from app.sessions.storage.digests import COLUMNS, KEY, Digests
from app.sessions.storage.files import remove
from app.sessions.storage.streams import pack_block
from app.sources.loaded_battery import LoadedBattery, team_battery
from app.telemetry import Event
from app.words import render

IDS_PER_CHUNK = 1 << 20
CHUNK_NS = 60_000_000_000
MEMORY_MAP = "memory_map"  # in place of a table: (t_mono_ns, hash) from IDENT; kept in `meta`
Row = tuple[Any, ...]
TableRow = tuple[str, Row]  # table and values

_INSERT = {
    "frames": ("INSERT INTO frames (t_mono_ns, t_wall_ns, link, ok, raw)", 5),
    "can_frames": ("INSERT INTO can_frames (t_mono_ns, t_wall_ns, can_id, data, bus)", 5),
    "measurements": ("INSERT INTO measurements (t_mono_ns, t_wall_ns, numbers)", 3),
    "estimates": ("INSERT INTO estimates (t_mono_ns, uptime_ms, soc, sigma)", 4),
    "events": (
        "INSERT INTO events (t_mono_ns, t_wall_ns, severity, code, text, cell, value, limit_value, unit, who, message)",
        11,
    ),
    "markers": ("INSERT INTO markers (t_mono_ns, t_wall_ns, kind, text, who)", 5),
    "configs": ("INSERT INTO configs (t_mono_ns, t_wall_ns, why, image)", 4),
    "clock": ("INSERT INTO clock (t_mono_ns, t_wall_ns, uptime_ms)", 3),
    "battery_files": ("INSERT INTO battery_files (name, data)", 2),
    "meta": ("INSERT OR REPLACE INTO meta (key, value)", 2),
}
_ROWS_AT_ONCE = 100  # in one statement


def event_row(t_mono_ns: int, event: Event, segments: Sequence[int] = ()) -> TableRow:
    """Return an event as a row of a session of a battery with packs of these sizes.

    Its English text is there for other programs and older versions.
    """
    values = (
        render(event.message, segments),
        event.cell,
        event.value,
        event.limit,
        event.unit,
        event.who,
        orjson.dumps(event.message).decode(),
    )
    return "events", (t_mono_ns, event.time_ns, event.severity, event.code, *values)


_RECEIVED = {
    "meta", "frames", "can_frames", "measurements", "estimates", "configs", "chunks", "series", "tracks", "columns",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Closing:
    """A chunk on its way into the file, with what it is of."""

    chunk: Chunk
    first_frame: int
    last_frame: int
    bad_frames: int
    boots: int
    last_uptime_ms: int | None
    last_estimate: int


class SessionWriter:
    """Writes one new session. Every method either has its effect on the disk or raises and changes nothing."""

    def __init__(
        self,
        info: SessionInfo,
        cell_file: str | None = None,
        battery: LoadedBattery | None = None,
        between: Callable[[], None] = lambda: None,
    ) -> None:
        """Create the session's tables in its file, which exists and is empty.

        Args:
            info: names the file and what it is.
            cell_file: what it is estimated with.
            battery: whose session it is; None, and the team's own, need no copy of their profile.
            between: called again and again while a chunk is packed, which may take long; may write.

        Raises:
            sqlite3.Error: the disk does not take it.
        """
        self._path = info.path
        self._connection = open_for_writing(info.path, SESSION)
        decodes_can = FOREIGN_CAN not in info.metadata
        self._builder = ChunkBuilder(battery=battery, decodes_can=decodes_can, map_hash=info.map_hash)
        self._between = between
        self._closing: _Closing | None = None
        self._digests = Digests()
        self._chunk_start_ns: int | None = None
        self._chunks = 0
        self._frames = 0
        self._bad_frames = 0  # bad frames of the chunk
        self._chunk_first_frame = 1
        self._series: dict[SeriesKey, int] = {}
        facts = {
            "id": info.id,
            "name": info.name,
            "voltwall": info.voltwall,
            "map_hash": info.map_hash,
            "start_mono_ns": str(info.started_mono_ns),
            "start_wall_ns": str(info.started_wall_ns),
            "metadata": json.dumps(dict(info.metadata)),
        }
        if cell_file is not None:
            facts["cell_file"] = cell_file
        self._watch = FileWatch(info.path, info.id)
        try:
            self.write([*(("meta", pair) for pair in facts.items()), *_battery_rows(battery)])
        except sqlite3.Error:
            self._connection.close()
            raise

    @property
    def path(self) -> Path:
        """Return the path of the file."""
        return self._path

    @property
    def size_bytes(self) -> int:
        """Return the size of file and log at the last `is_intact`."""
        return self._watch.size_bytes

    @property
    def cells(self) -> set[int]:
        """Cells of which a voltage is in a chunk."""
        voltages = [key for key in self._series if key.field == "v"]
        return {key.first_element + i for key in voltages for i in range(key.elements)}

    @property
    def bad_checksums(self) -> int:
        """CAN frames whose checksum, by the battery's profile, does not fit."""
        return self._builder.bad_checksums

    @property
    def absent_values(self) -> int:
        """Temperatures of sensors that are not connected."""
        return self._builder.absent_values

    def is_intact(self) -> bool:
        """Return whether what was written is still in the file: see `FileWatch`."""
        return self._watch.is_intact()

    def write(self, items: Sequence[TableRow]) -> None:
        """Commit the items, in order within each table.

        Raises:
            sqlite3.Error: none of them was written.
        """
        rows: dict[str, list[Row]] = defaultdict(list)
        for table, row in items:
            rows[table].append(row)
        if rows["estimates"]:
            rows["estimates"] = _encoded(rows["estimates"])
        maps = rows.pop(MEMORY_MAP, [])
        rows["meta"] += [("map_hash", map_hash) for _, map_hash in maps]
        if maps and self._chunks:  # where digests stand in the file, they are of all that it says of itself
            digests = self._digests.copy()
            for table, of_table in rows.items():
                digests.take(table, of_table)
            rows["meta"].append((KEY, digests.text()))
        with _transaction(self._connection):
            for table, of_table in rows.items():
                _insert(self._connection, table, of_table)
        for table, of_table in rows.items():
            self._digests.take(table, of_table)
        if maps:
            self._builder.map_hash = maps[-1][1]
        self._builder.add(
            [(row[0], row[4]) for row in rows["frames"] if row[3]],
            [(row[0], row[2], row[3]) for row in rows["can_frames"] if not row[4]],
            [(row[0], row[3]) for row in rows["configs"]],
            [(row[0], row[2]) for row in rows["measurements"]],
        )
        self._bad_frames += sum(not row[3] for row in rows["frames"])
        for row in rows["estimates"]:
            self._builder.add_estimate(*row)
        if self._chunk_start_ns is None:
            first = [row for table in ("frames", "estimates", "can_frames", "measurements") for row in rows[table][:1]]
            self._chunk_start_ns = min((row[0] for row in first), default=None)
        self._frames += len(rows["frames"])
        self._watch.written()

    def close_chunk_if_due(self, t_mono_ns: int) -> None:
        """Close the chunk once it is a minute long.

        Raises:
            sqlite3.Error: it stays open.
        """
        is_due = self._chunk_start_ns is not None and t_mono_ns - self._chunk_start_ns >= CHUNK_NS
        if is_due or self._closing is not None:
            self._close_chunk()

    def close(self, t_mono_ns: int, t_wall_ns: int) -> None:
        """Write the last chunk and the end, and close the file.

        Raises:
            sqlite3.Error: the file is as it was, and still open.
        """
        if self._closing is not None:
            self._close_chunk()
        self._close_chunk()
        end = [("meta", ("end_mono_ns", str(t_mono_ns))), ("meta", ("end_wall_ns", str(t_wall_ns)))]
        digests = self._digests.copy()
        digests.take("meta", [pair for _, pair in end])
        self.write([*end, ("meta", (KEY, digests.text()))])
        self._watch.close()
        # The estimates that a chunk took over left free pages; execute() would take one step of this and stop.
        self._connection.executescript("PRAGMA incremental_vacuum")
        # A closed session is one file that any tool opens, also on a read-only medium; not where somebody reads it now.
        self._connection.execute("PRAGMA busy_timeout = 0")
        self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        with suppress(sqlite3.OperationalError):
            self._connection.execute("PRAGMA journal_mode = DELETE")
        self._connection.close()

    def copy_other_tables(self, path: Path) -> None:
        """Take over every table of another session that is neither received nor made of what was received.

        Raises:
            sqlite3.Error: the disk does not take them, or the file is damaged.
        """
        self._connection.execute("ATTACH ? AS other", (str(path),))
        try:
            names = {
                schema: {row[0] for row in self._connection.execute(f"SELECT name FROM {schema}.sqlite_master")}
                for schema in ("main", "other")
            }
            with _transaction(self._connection):
                for table in sorted((names["main"] & names["other"]) - _RECEIVED):
                    if not table.startswith("sqlite_"):
                        about = self._connection.execute(f"PRAGMA other.table_info({table})")
                        columns = ", ".join(row[1] for row in about)  # an older file has fewer columns
                        self._connection.execute(f"DELETE FROM main.{table}")
                        self._connection.execute(
                            f"INSERT INTO main.{table} ({columns}) SELECT {columns} FROM other.{table}"
                        )
            for table in COLUMNS.keys() & ((names["main"] & names["other"]) - _RECEIVED):
                self._digests.restart(
                    table, self._connection.execute(f"SELECT {COLUMNS[table]} FROM main.{table} ORDER BY id")
                )
        finally:
            self._connection.execute("DETACH other")

    def abandon(self) -> None:
        """Close the file as it is: what was committed stays, the session remains marked as not closed."""
        self._watch.close()
        self._connection.close()

    def discard(self) -> None:
        """Close the file and delete it: nothing came into it."""
        self._watch.close()
        self._connection.close()
        remove(self._path)

    def _close_chunk(self) -> None:
        """Pack what was received since the last chunk; it is tried again where the disk does not take it."""
        if self._closing is None:
            if self._frames < self._chunk_first_frame and not len(self._builder):
                return
            self._closing = self._begin_closing()
        closing, chunk = self._closing, self._closing.chunk
        number = self._chunks + 1
        first_us, last_us = chunk.span_us
        new = {
            key: len(self._series) + i for i, key in enumerate(key for key in chunk.columns if key not in self._series)
        }
        of_frames = (closing.first_frame, closing.last_frame, closing.bad_frames)
        row = (number, *of_frames, first_us, last_us, closing.boots, closing.last_uptime_ms)
        series = [(i, key.field, key.first_element, key.elements, key.dtype) for key, i in new.items()]
        tracks, columns = _columns(chunk, number * IDS_PER_CHUNK, self._series | new, self._between)
        digests = self._digests.copy()
        for table, rows in (("chunks", [row]), ("series", series), ("tracks", tracks), ("columns", columns)):
            digests.take_with_ids(table, rows)
        with _transaction(self._connection):
            self._connection.execute("INSERT INTO chunks VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)
            self._connection.executemany("INSERT INTO series VALUES (?, ?, ?, ?, ?)", series)
            self._connection.executemany("INSERT INTO tracks VALUES (?, ?, ?, ?)", tracks)
            self._connection.executemany("INSERT INTO columns VALUES (?, ?, ?, ?)", columns)
            self._connection.execute("DELETE FROM estimates WHERE id <= ?", (closing.last_estimate,))
            _insert(self._connection, "meta", [(KEY, digests.text())])
        self._digests = digests
        self._series |= new
        self._chunks = number
        self._closing = None

    def _begin_closing(self) -> _Closing:
        """Take what is packed; what is written from now on belongs to the next chunk."""
        ((last_estimate,),) = self._connection.execute("SELECT coalesce(max(id), 0) FROM estimates")
        frames = (self._chunk_first_frame, self._frames, self._bad_frames)
        closing = _Closing(self._builder.build(), *frames, *self._builder.master_clock, last_estimate)
        self._chunk_first_frame = self._frames + 1
        self._chunk_start_ns = None
        self._bad_frames = 0
        self._builder.clear()
        return closing


def _insert(connection: sqlite3.Connection, table: str, rows: Sequence[Row]) -> None:
    """Insert rows by few statements: at the end of each the interpreter goes to another thread, and waits for its turn.

    Raises:
        sqlite3.Error: the disk does not take them.
    """
    insert, columns = _INSERT[table]
    places = f"({', '.join('?' * columns)})"
    for i in range(0, len(rows), _ROWS_AT_ONCE):
        some = rows[i : i + _ROWS_AT_ONCE]
        connection.execute(f"{insert} VALUES {', '.join([places] * len(some))}", [*chain.from_iterable(some)])


def _columns(
    chunk: Chunk, base: int, series: dict[SeriesKey, int], between: Callable[[], None]
) -> tuple[list[Row], list[Row]]:
    """Rows of the tables `tracks` and `columns`, in the order of their ids."""
    tracks: list[Row] = []
    for number, track in enumerate(chunk.tracks):
        _, times_us = pack_block(track.times_us[:, None])
        _, instants = pack_block(track.instants[:, None])
        tracks.append((base + number, len(track.times_us), times_us, instants))
        between()
    columns: list[Row] = []
    for key, (number, values) in chunk.columns.items():
        columns.append((base + series[key], base + number, *pack_block(values)))
        between()
    return tracks, sorted(columns, key=itemgetter(0))


def _battery_rows(battery: LoadedBattery | None) -> list[TableRow]:
    """What explains the frames, where the battery is not the team's own; a copy of it has a name of its own."""
    if battery is None or battery.battery == team_battery().battery:
        return []
    return [("battery_files", file) for file in battery.files.items()]


def _encoded(rows: list[Row]) -> list[Row]:
    soc, sigma = (encode_estimate(np.array([row[i] for row in rows])) for i in (2, 3))
    size = len(soc) // len(rows)
    return [
        (row[0], row[1], soc[i * size : (i + 1) * size], sigma[i * size : (i + 1) * size]) for i, row in enumerate(rows)
    ]


@contextmanager
def _transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """All or nothing; a failing rollback is the failure of the transaction, which is already on its way up."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise
