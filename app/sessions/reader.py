"""Reading a session, closed or not, also while it is being recorded. Changes nothing in it."""

import json
import sqlite3
import threading
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from heapq import merge
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from app.sessions.chunks import Chunk, ChunkBuilder
from app.sessions.database import open_for_reading
from app.sessions.errors import NotASession
from app.sessions.info import Marker, RecordedCanFrame, RecordedConfig, RecordedFrame, SessionInfo, size_on_disk
from app.sessions.migrate import SESSION
from app.sessions.series import Series, reduce_samples
from app.sessions.session_writer import IDS_PER_CHUNK
from app.sessions.signals import Signal, find_signal
from app.sessions.streams import IntArray, stream_range, unpack_stream
from firmware_protocol.memory_map import CONFIG, FIELDS

MAX_POINTS = 100_000
Received = RecordedFrame | RecordedCanFrame | RecordedConfig
_CACHED_TRACKS = 2048
_FETCH_ROWS = 500


class SessionFile:
    """One session, opened for reading, by any thread; times in seconds are unix time.

    Unix time is the monotonic clock put onto the wall clock as it was last known, so a step of the wall clock in the
    middle of a session moves no sample against another.
    """

    def __init__(self, path: Path) -> None:
        """Open the file.

        Raises:
            NotASession: missing, damaged, or something else.
            SchemaTooNew: a newer program wrote it.
        """
        self.path = path
        self._connection = open_for_reading(path, SESSION)
        self._lock = threading.RLock()
        self._tracks: dict[int, tuple[NDArray[np.int64], NDArray[np.int64]]] = {}
        self._tail: tuple[tuple[int, int, int], Chunk] | None = None
        try:
            with self.consistent():
                self._meta = dict(self._connection.execute("SELECT key, value FROM meta"))
                self._offset_ns = self._wall_offset_ns()
        except (sqlite3.Error, KeyError) as error:
            self._connection.close()
            raise NotASession(str(path), f"damaged: {error}") from error

    def __enter__(self) -> "SessionFile":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    @contextmanager
    def consistent(self) -> Iterator[None]:
        """Everything read inside is of one instant, whatever is recorded meanwhile."""
        with self._lock:
            if self._connection.in_transaction:
                yield
                return
            self._connection.execute("BEGIN")
            try:
                yield
            finally:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")

    @property
    def info(self) -> SessionInfo:
        """What there is to say about the session; quick however long it is."""
        with self.consistent():
            meta = dict(self._connection.execute("SELECT key, value FROM meta"))
            counts = {t: self._last_id(t) for t in ("frames", "can_frames", "events", "markers")}
            is_closed = "end_mono_ns" in meta
            start = int(meta["start_mono_ns"])
            end = int(meta["end_mono_ns"]) if is_closed else max(start, *self._last_times())
        return SessionInfo(
            id=self.path.stem,
            path=self.path,
            name=meta["name"],
            started_wall_ns=start + self._offset_ns,
            started_mono_ns=start,
            ended_wall_ns=end + self._offset_ns,
            ended_mono_ns=end,
            is_closed=is_closed,
            size_bytes=size_on_disk(self.path),
            voltwall=meta["voltwall"],
            map_hash=meta["map_hash"],
            metadata=json.loads(meta["metadata"]),
            **counts,
        )

    def unix_s(self, t_mono_ns: int) -> float:
        """Return the unix time of an instant of the recording machine's monotonic clock."""
        return (t_mono_ns + self._offset_ns) / 1e9

    def mono_ns(self, unix_s: float) -> int:
        """Return the monotonic time of a unix time."""
        return round(unix_s * 1e9) - self._offset_ns

    def frames(self, t_from_s: float | None = None, t_to_s: float | None = None) -> Iterator[RecordedFrame]:
        """Yield the serial frames of a range, both ends included, as received and in that order."""
        for row in self._rows("frames", "t_mono_ns, t_wall_ns, link, raw, ok", t_from_s, t_to_s):
            yield RecordedFrame(row[0], row[1], row[2], row[3], bool(row[4]))

    def can_frames(self, t_from_s: float | None = None, t_to_s: float | None = None) -> Iterator[RecordedCanFrame]:
        """Yield the CAN frames of a range, both ends included, in order."""
        for row in self._rows("can_frames", "t_mono_ns, t_wall_ns, can_id, data", t_from_s, t_to_s):
            yield RecordedCanFrame(*row)

    def configs(self) -> list[RecordedConfig]:
        """Every configuration in force, in order."""
        with self._lock:
            rows = self._connection.execute("SELECT t_mono_ns, t_wall_ns, why, image FROM configs ORDER BY id")
            return [RecordedConfig(*row) for row in rows]

    def received(self, t_from_s: float | None = None, t_to_s: float | None = None) -> Iterator[Received]:
        """Yield everything that came from the master, in order of arrival; all configurations, whatever the range."""
        sources: list[Iterable[Received]] = [
            self.configs(),
            self.frames(t_from_s, t_to_s),
            self.can_frames(t_from_s, t_to_s),
        ]
        yield from merge(*sources, key=lambda item: item.t_mono_ns)

    def markers(self) -> list[Marker]:
        """All markers, in order."""
        with self._lock:
            rows = self._connection.execute("SELECT id, t_mono_ns, t_wall_ns, kind, text, who FROM markers ORDER BY id")
            return [Marker(*row) for row in rows]

    def events(self) -> list[dict[str, object]]:
        """All events of the session, in order, each with the columns of the table `events`."""
        with self._lock:
            cursor = self._connection.execute("SELECT * FROM events ORDER BY id")
            names = [column[0] for column in cursor.description]
            return [dict(zip(names, row, strict=True)) for row in cursor]

    def series(
        self,
        signals: Sequence[str],
        t_from_s: float | None = None,
        t_to_s: float | None = None,
        points: int = 2000,
    ) -> dict[str, Series]:
        """Return each signal over a range with smallest and largest value per point.

        Raises:
            UnknownSignal: a name means nothing.
            ValueError: `points` is not within 1..MAX_POINTS.
        """
        if not 1 <= points <= MAX_POINTS:
            raise ValueError(f"points = {points}: 1..{MAX_POINTS}")
        found = [find_signal(name) for name in signals]
        result = {}
        with self.consistent():
            for signal in found:
                times_us, _, counts = self.samples(signal, t_from_s, t_to_s)
                times_s = (times_us * 1000 + self._offset_ns) / 1e9
                result[signal.name] = reduce_samples(signal.name, signal.unit, times_s, signal.physical(counts), points)
        return result

    def samples(
        self, signal: Signal, t_from_s: float | None = None, t_to_s: float | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], IntArray]:
        """Return (times, instants, counts) of every sample in a range, ends included, in order of time.

        Times are microseconds of the monotonic clock; samples of one instant of the master share their instant.
        """
        first_us = -(1 << 62) if t_from_s is None else self.mono_ns(t_from_s) // 1000
        last_us = 1 << 62 if t_to_s is None else self.mono_ns(t_to_s) // 1000
        with self.consistent():
            parts = [*self._stored(signal, first_us, last_us), *self._unstored(signal)]
            if not parts and signal.field.startswith("conf."):
                parts = self._from_configs(signal)
        if not parts:
            empty = np.empty(0, np.int64)
            return empty, empty, empty
        times_us, instants, counts = (np.concatenate(column) for column in zip(*parts, strict=True))
        if (np.diff(times_us) < 0).any():
            order = np.argsort(times_us, kind="stable")
            times_us, instants, counts = times_us[order], instants[order], counts[order]
        low, high = np.searchsorted(times_us, first_us), np.searchsorted(times_us, last_us, side="right")
        return times_us[low:high], instants[low:high], counts[low:high]

    def chunk_spans_us(self) -> list[tuple[int, int]]:
        """First and last sample time of each stored chunk and of what came after them, monotonic microseconds."""
        with self.consistent():
            spans = [tuple(row) for row in self._connection.execute("SELECT first_us, last_us FROM chunks ORDER BY id")]
            spans.append(self._build_tail().span_us)
        return [(first, last) for first, last in spans if first <= last]

    def has_signal(self, name: str) -> bool:
        """Whether the session holds any sample of a signal.

        Raises:
            UnknownSignal: the name means nothing.
        """
        signal = find_signal(name)
        with self.consistent():
            return bool(
                self._series_ids(signal)
                or self._unstored(signal)
                or (signal.field.startswith("conf.") and self._last_id("configs"))
            )

    def signal_names(self) -> list[str]:
        """Fields and estimates of which the session holds samples, without indices, in the memory map's order."""
        with self.consistent():
            names = {row[0] for row in self._connection.execute("SELECT DISTINCT field FROM series")}
            names |= {key.field for key in self._build_tail().columns}
            if self._last_id("configs"):
                names |= {f"conf.{name}" for name in CONFIG}
        order = {name: i for i, name in enumerate(FIELDS)}
        return sorted(names, key=lambda name: (order.get(name, len(order)), name))

    def problems(self) -> list[str]:
        """Look at every byte; an empty list is a sound file. Takes seconds for a long session."""
        try:
            found = [row[0] for row in self._connection.execute("PRAGMA quick_check(10)") if row[0] != "ok"]
            for table in ("frames", "can_frames"):
                n = self._connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
                if n != self._last_id(table):
                    found.append(f"{table}: {self._last_id(table) - n} rows are missing")
        except sqlite3.DatabaseError as error:
            found = [str(error)]
        return found

    def copy_to(self, path: Path) -> None:
        """Write the session as one file without a log beside it, complete up to now."""
        target = sqlite3.connect(path)
        try:
            self._connection.backup(target)
            target.execute("PRAGMA journal_mode = DELETE")
        finally:
            target.close()

    def _wall_offset_ns(self) -> int:
        row = self._connection.execute("SELECT t_wall_ns - t_mono_ns FROM clock ORDER BY id DESC LIMIT 1").fetchone()
        return int(row[0]) if row else int(self._meta["start_wall_ns"]) - int(self._meta["start_mono_ns"])

    def _last_id(self, table: str) -> int:
        return int(self._connection.execute(f"SELECT coalesce(max(id), 0) FROM {table}").fetchone()[0])

    def _last_times(self) -> list[int]:
        rows = (
            self._connection.execute(f"SELECT t_mono_ns FROM {table} ORDER BY id DESC LIMIT 1").fetchone()
            for table in ("frames", "can_frames", "clock")
        )
        return [row[0] for row in rows if row]

    def _rows(self, table: str, columns: str, t_from_s: float | None, t_to_s: float | None) -> Iterator[tuple]:  # type: ignore[type-arg]
        first = 1 if t_from_s is None else self._first_id_at(table, self.mono_ns(t_from_s))
        last_ns = None if t_to_s is None else self.mono_ns(t_to_s)
        while True:
            with self._lock:
                rows = self._connection.execute(
                    f"SELECT id, {columns} FROM {table} WHERE id >= ? ORDER BY id LIMIT {_FETCH_ROWS}", (first,)
                ).fetchall()
            for row in rows:
                if last_ns is not None and row[1] > last_ns:
                    return
                yield row[1:]
            if len(rows) < _FETCH_ROWS:
                return
            first = rows[-1][0] + 1

    def _first_id_at(self, table: str, t_mono_ns: int) -> int:
        with self.consistent():
            low, high = 1, self._last_id(table) + 1
            while low < high:
                middle = (low + high) // 2
                row = self._connection.execute(f"SELECT t_mono_ns FROM {table} WHERE id = ?", (middle,)).fetchone()
                low, high = (middle + 1, high) if row[0] < t_mono_ns else (low, middle)
        return low

    def _series_ids(self, signal: Signal) -> list[tuple[int, int, str]]:
        return self._connection.execute(
            "SELECT id, ? - first_element, dtype FROM series"
            " WHERE field = ? AND ? BETWEEN first_element AND first_element + elements - 1",
            (signal.element, signal.field, signal.element),
        ).fetchall()

    def _stored(
        self, signal: Signal, first_us: int, last_us: int
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], IntArray]]:
        for series_id, element, dtype in self._series_ids(signal):
            rows = self._connection.execute(
                f"SELECT c.id, c.track, c.ends FROM chunks k JOIN columns c ON c.id = k.id * {IDS_PER_CHUNK} + ?"
                " WHERE k.last_us >= ? AND k.first_us <= ? ORDER BY k.id",
                (series_id, first_us, last_us),
            ).fetchall()
            for column_id, track_id, ends in rows:
                times_us, instants = self._track(track_id)
                start, end = stream_range(ends, element)
                with self._connection.blobopen("columns", "data", column_id, readonly=True) as blob:
                    blob.seek(start)
                    stream = blob.read(end - start)
                yield times_us, instants, self._unpack(stream, dtype, len(times_us))

    def _track(self, track_id: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        if track_id not in self._tracks:
            n, times_us, instants = self._connection.execute(
                "SELECT samples, times_us, instants FROM tracks WHERE id = ?", (track_id,)
            ).fetchone()
            while len(self._tracks) >= _CACHED_TRACKS:
                del self._tracks[next(iter(self._tracks))]
            self._tracks[track_id] = (
                self._unpack(times_us, "<i8", n).astype(np.int64),
                self._unpack(instants, "<i8", n).astype(np.int64),
            )
        return self._tracks[track_id]

    def _unpack(self, stream: bytes, dtype: str, n_samples: int) -> IntArray:
        try:
            return unpack_stream(stream, dtype, n_samples)
        except (ValueError, zlib.error) as error:
            raise NotASession(str(self.path), f"damaged: {error}") from error

    def _unstored(self, signal: Signal) -> list[tuple[NDArray[np.int64], NDArray[np.int64], IntArray]]:
        tail = self._build_tail()
        return [
            (tail.tracks[number].times_us, tail.tracks[number].instants, values[:, signal.element - key.first_element])
            for key, (number, values) in tail.columns.items()
            if key.field == signal.field and 0 <= signal.element - key.first_element < key.elements
        ]

    def _build_tail(self) -> Chunk:
        """Decode what came after the last stored chunk."""
        state = (self._last_id("frames"), self._last_id("estimates"), self._last_id("chunks"))
        if self._tail is None or self._tail[0] != state:
            row = self._connection.execute(
                "SELECT last_frame, boots, last_uptime_ms FROM chunks ORDER BY id DESC LIMIT 1"
            ).fetchone()
            last_frame, boots, last_uptime_ms = row or (0, 0, None)
            builder = ChunkBuilder(boots, last_uptime_ms)
            for t_mono_ns, raw in self._connection.execute(
                "SELECT t_mono_ns, raw FROM frames WHERE id > ? AND ok ORDER BY id", (last_frame,)
            ):
                builder.add_frame(t_mono_ns, raw)
            for estimate in self._connection.execute(
                "SELECT t_mono_ns, uptime_ms, soc, sigma FROM estimates ORDER BY id"
            ):
                builder.add_estimate(*estimate)
            self._tail = (state, builder.build())
        return self._tail[1]

    def _from_configs(self, signal: Signal) -> list[tuple[NDArray[np.int64], NDArray[np.int64], IntArray]]:
        configs = self.configs()
        if not configs:
            return []
        field = FIELDS[signal.field]
        times = [config.t_mono_ns // 1000 for config in configs]
        values = [field.unpack(config.image)[signal.element] for config in configs]
        end = max([*self._last_times(), configs[-1].t_mono_ns]) // 1000
        times_us = np.array([*times, end], np.int64)
        return [(times_us, -times_us, np.array([*values, values[-1]], np.int64))]
