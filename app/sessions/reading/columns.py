"""The samples of one signal: from stored chunks, and decoded on the spot for what came after them."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.sessions.recording.session_writer import IDS_PER_CHUNK
from app.sessions.storage.chunks import ESTIMATES, FOREIGN_CAN, Chunk, ChunkBuilder
from app.sessions.storage.queries import StoredSession
from app.sessions.storage.signals import Signal
from app.sessions.storage.streams import IntArray, stream_range, unpack_block, unpack_stream
from firmware_protocol.memory_map import FIELDS

_CACHED_TRACKS = 2048
_ALWAYS_US = 1 << 50
TimeArray = NDArray[np.int64]
CountArray = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Samples:
    """The (n,) samples of a signal in order of time."""

    times_us: TimeArray  # monotonic
    counts: IntArray
    instants: TimeArray | None = None  # the same number: sampled by the master at the same time; only where asked for


@dataclass(frozen=True, slots=True)
class Block:
    """Samples of consecutive elements of a field: (n,) monotonic times and (n, elements) counts."""

    times_us: TimeArray
    counts: IntArray
    first_element: int


_Part = tuple[TimeArray, IntArray, TimeArray | None]


class ColumnReader:
    """Reads signals of a session. Keeps sample times that were read, and the last decoded tail."""

    def __init__(self, stored: StoredSession) -> None:
        self._stored = stored
        self._tracks: dict[tuple[int, str], TimeArray] = {}
        self._tail: tuple[tuple[int, ...], Chunk] | None = None

    def samples(self, signal: Signal, first_us: int, last_us: int, *, instants: bool = False) -> Samples:
        """Return every sample of a range of monotonic time, ends included."""
        with self._stored.consistent():
            parts = [*self._from_chunks(signal, first_us, last_us, instants), *self._from_tail(signal)]
            if not parts and signal.field.startswith("conf."):
                parts = self._from_configs(signal)
        if not parts:
            empty = np.empty(0, np.int64)
            return Samples(empty, empty, empty)
        times_us = np.concatenate([part[0] for part in parts])
        counts = np.concatenate([part[1] for part in parts])
        of_master = np.concatenate([part[2] for part in parts if part[2] is not None]) if instants else None
        if (np.diff(times_us) < 0).any():
            order = np.argsort(times_us, kind="stable")
            times_us, counts = times_us[order], counts[order]
            of_master = None if of_master is None else of_master[order]
        low, high = np.searchsorted(times_us, first_us), np.searchsorted(times_us, last_us, side="right")
        return Samples(times_us[low:high], counts[low:high], None if of_master is None else of_master[low:high])

    def blocks(self, fields: Sequence[str], first_us: int, last_us: int) -> Iterator[dict[str, list[Block]]]:
        """Yield, a chunk at a time, what a range of monotonic time holds of whole fields; the last one is the tail.

        Args:
            fields: of the memory map, or estimates.
            first_us: start of the range, inclusive.
            last_us: its end, inclusive.
        """
        marks = ",".join("?" * len(fields))
        series = self._stored.rows(
            f"SELECT id, field, first_element, dtype FROM series WHERE field IN ({marks}) ORDER BY id", tuple(fields)
        )
        spans = "SELECT id FROM chunks WHERE last_us >= ? AND first_us <= ? ORDER BY id"
        for (chunk_id,) in self._stored.rows(spans, (first_us, last_us)):
            found: dict[str, list[Block]] = {}
            for series_id, field, first_element, dtype in series:
                row = self._stored.rows(
                    "SELECT track, ends, data FROM columns WHERE id = ?", (chunk_id * IDS_PER_CHUNK + series_id,)
                )
                if row:
                    track_id, ends, data = row[0]
                    times_us = self._track(track_id, "times_us")
                    with self._stored.sound():
                        counts = unpack_block(ends, data, dtype, len(times_us))
                    found.setdefault(field, []).append(_cut(Block(times_us, counts, first_element), first_us, last_us))
            yield found
        tail = self._build_tail()
        rest: dict[str, list[Block]] = {}
        for key, (number, values) in tail.columns.items():
            if key.field in fields:
                block = _cut(Block(tail.tracks[number].times_us, values, key.first_element), first_us, last_us)
                rest.setdefault(key.field, []).append(block)
        yield rest

    def estimates(self) -> Iterator[tuple[int, int, CountArray, CountArray]]:
        """Yield every estimate: (monotonic time [ns], the master's clock [ms], (96,) SOC, (96,) sigma) in counts."""
        for (chunk_id,) in self._stored.rows("SELECT id FROM chunks ORDER BY id"):
            pair = []
            for name in ESTIMATES:
                for track_id, ends, data in self._stored.rows(
                    "SELECT c.track, c.ends, c.data FROM series s JOIN columns c ON c.id = ? + s.id WHERE s.field = ?",
                    (chunk_id * IDS_PER_CHUNK, name),
                ):
                    times_us, instants = self._track(track_id, "times_us"), self._track(track_id, "instants")
                    with self._stored.sound():
                        pair.append(unpack_block(ends, data, "<u2", len(times_us)))
            if len(pair) == len(ESTIMATES):
                uptimes_ms = instants & 0xFFFFFFFF
                yield from zip((times_us * 1000).tolist(), uptimes_ms.tolist(), *pair, strict=True)
        for t_ns, uptime_ms, soc, sigma in self._stored.rows(
            "SELECT t_mono_ns, uptime_ms, soc, sigma FROM estimates ORDER BY id"
        ):
            with self._stored.sound():
                pair = [np.frombuffer(counts, "<u2") for counts in (soc, sigma)]
            yield t_ns, uptime_ms, *pair

    def spans_us(self) -> list[tuple[int, int]]:
        """First and last sample time of each chunk and of what came after them, monotonic microseconds."""
        with self._stored.consistent():
            spans = [(row[0], row[1]) for row in self._stored.rows("SELECT first_us, last_us FROM chunks ORDER BY id")]
            spans.append(self._build_tail().span_us)
        return [(first, last) for first, last in spans if first <= last]

    def fields(self) -> set[str]:
        """Fields and estimates of which there are samples."""
        with self._stored.consistent():
            names = {row[0] for row in self._stored.rows("SELECT DISTINCT field FROM series")}
            return names | {key.field for key in self._build_tail().columns}

    def _from_chunks(self, signal: Signal, first_us: int, last_us: int, instants: bool) -> Iterator[_Part]:
        for series_id, element, dtype in self._stored.rows(
            "SELECT id, ? - first_element, dtype FROM series"
            " WHERE field = ? AND ? BETWEEN first_element AND first_element + elements - 1",
            (signal.element, signal.field, signal.element),
        ):
            for column_id, track_id, ends in self._stored.rows(
                f"SELECT c.id, c.track, c.ends FROM chunks k JOIN columns c ON c.id = k.id * {IDS_PER_CHUNK} + ?"
                " WHERE k.last_us >= ? AND k.first_us <= ? ORDER BY k.id",
                (series_id, first_us, last_us),
            ):
                times_us = self._track(track_id, "times_us")
                stream = self._stored.part_of_column(column_id, *stream_range(ends, element))
                counts = self._unpack(stream, dtype, len(times_us))
                yield times_us, counts, self._track(track_id, "instants") if instants else None

    def _track(self, track_id: int, column: str) -> TimeArray:
        key = (track_id, column)
        if key not in self._tracks:
            with self._stored.sound():
                ((n, stream),) = self._stored.rows(f"SELECT samples, {column} FROM tracks WHERE id = ?", (track_id,))
            while len(self._tracks) >= _CACHED_TRACKS:
                del self._tracks[next(iter(self._tracks))]
            self._tracks[key] = self._unpack(stream, "<i8", n).astype(np.int64, copy=False)
        return self._tracks[key]

    def _unpack(self, stream: bytes, dtype: str, n_samples: int) -> IntArray:
        with self._stored.sound():
            return unpack_stream(stream, dtype, n_samples)

    def _from_tail(self, signal: Signal) -> list[_Part]:
        tail = self._build_tail()
        return [
            (tail.tracks[number].times_us, values[:, signal.element - key.first_element], tail.tracks[number].instants)
            for key, (number, values) in tail.columns.items()
            if key.field == signal.field and 0 <= signal.element - key.first_element < key.elements
        ]

    def _build_tail(self) -> Chunk:
        """Decode what came after the last chunk."""
        with self._stored.sound():
            return self._decode_tail()

    def _decode_tail(self) -> Chunk:
        stored = self._stored
        state = tuple(stored.last_id(table) for table in ("frames", "can_frames", "estimates", "chunks"))
        if self._tail is None or self._tail[0] != state:
            last_chunk = stored.rows("SELECT last_frame, boots, last_uptime_ms FROM chunks ORDER BY id DESC LIMIT 1")
            last_frame, boots, last_uptime_ms = last_chunk[0] if last_chunk else (0, 0, None)
            ((last_us,),) = stored.rows("SELECT coalesce(max(last_us), ?) FROM chunks", (-_ALWAYS_US,))
            before = "SELECT t_mono_ns FROM frames WHERE id <= ? AND ok ORDER BY id DESC LIMIT 1"
            last_good = stored.rows(before, (last_frame,))
            metadata = stored.rows("SELECT value FROM meta WHERE key = 'metadata'")
            builder = ChunkBuilder(
                boots,
                last_uptime_ms,
                last_good[0][0] if last_good else None,
                decodes_can=not metadata or FOREIGN_CAN not in json.loads(metadata[0][0]),
            )
            builder.add(
                stored.rows("SELECT t_mono_ns, raw FROM frames WHERE id > ? AND ok ORDER BY id", (last_frame,)),
                stored.iterate("can_frames", "t_mono_ns, can_id, data", (last_us + 1) * 1000, None),
                stored.rows("SELECT t_mono_ns, image FROM configs ORDER BY id"),
            )
            for row in stored.rows("SELECT t_mono_ns, uptime_ms, soc, sigma FROM estimates ORDER BY id"):
                builder.add_estimate(*row)
            self._tail = (state, builder.build())
        return self._tail[1]

    def _from_configs(self, signal: Signal) -> list[_Part]:
        """What the images in force say, each from its time on, to the end of the session."""
        rows = self._stored.rows("SELECT t_mono_ns, image FROM configs ORDER BY id")
        if not rows:
            return []
        last_frame = self._stored.rows("SELECT t_mono_ns FROM frames ORDER BY id DESC LIMIT 1")
        end_ns = max(row[0] for row in (rows[-1], *last_frame))
        times_us = np.array([*(row[0] for row in rows), end_ns], np.int64) // 1000
        with self._stored.sound():
            values = [FIELDS[signal.field].unpack(row[1])[signal.element] for row in rows]
        return [(times_us, np.array([*values, values[-1]], np.int64), -times_us)]


def _cut(block: Block, first_us: int, last_us: int) -> Block:
    low = int(np.searchsorted(block.times_us, first_us))
    high = int(np.searchsorted(block.times_us, last_us, side="right"))
    return Block(block.times_us[low:high], block.counts[low:high], block.first_element)
