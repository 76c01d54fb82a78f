"""The samples of a session in blocks of about a minute: stored chunks, then what was received after the last one."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.battery.serial import SerialMapping
from app.battery.source import DbcMapping
from app.estimation.arrays import FloatArray
from app.sessions.reading.session_info import meta_of
from app.sessions.recording.session_writer import IDS_PER_CHUNK
from app.sessions.storage.battery_columns import Holder, Samples, grid_of
from app.sessions.storage.battery_fields import IS_NEW, ages_of
from app.sessions.storage.chunks import FOREIGN_CAN, Chunk, ChunkBuilder, Track
from app.sessions.storage.queries import StoredSession
from app.sessions.storage.signals import Signals
from app.sessions.storage.streams import CountArray, stream_ranges, unpack_streams
from app.sources.data_file import parse_object
from app.sources.dbc.assembly import UNKNOWN_AGE_S
from app.sources.loaded_battery import LoadedBattery
from firmware_protocol.older_maps import FIRST_MAP, fields_of, first_image

_ALWAYS_US = 1 << 50
ElementArray = NDArray[np.intp]


class BlockColumn:
    """Samples of k elements of a field. Columns sampled together share one track, of (n,) ascending times."""

    def __init__(
        self,
        field: str,
        elements: ElementArray,
        track: Track,
        decode: Callable[[], CountArray],
        keep: Any = slice(None),
    ) -> None:
        self.field = field
        self.elements = elements  # (k,) ascending
        self.track = track
        self._decode = decode
        self._keep = keep  # which samples `decode` returns

    @cached_property
    def counts(self) -> CountArray:
        """(n, k) values as stored; decoded when first asked for."""
        counts: CountArray = self._decode()[self._keep]
        return counts

    def cut(self, track: Track, keep: Any) -> "BlockColumn":
        """Return the column with some of its samples."""
        return BlockColumn(self.field, self.elements, track, self._decode, keep)


@dataclass(frozen=True, slots=True)
class Block:
    """All samples of the wanted elements in about a minute."""

    columns: tuple[BlockColumn, ...]

    @property
    def first_us(self) -> int:
        """Time of the first sample."""
        return min(int(column.track.times_us[0]) for column in self.columns)

    @property
    def last_us(self) -> int:
        """Time of the last sample."""
        return max(int(column.track.times_us[-1]) for column in self.columns)


class BlockReader:
    """Reads the blocks of a session. Keeps the last decoded tail."""

    def __init__(self, stored: StoredSession, battery: LoadedBattery, map_hash: str | None) -> None:
        self._stored = stored
        self._battery = battery
        self._map_hash = map_hash
        self._tail: tuple[tuple[int, ...], Chunk] | None = None

    def blocks(self, wanted: Mapping[str, ElementArray], first_us: int, last_us: int) -> Iterator[Block]:
        """Yield the samples of a range of monotonic time, ends included, each block decoded once; none is empty.

        The blocks are of one instant, whatever is recorded meanwhile. A field of the configuration of which nothing was
        sampled comes first, from the images in force.

        Args:
            wanted: fields of the memory map, or estimates, with the elements to read, ascending.
            first_us: start of the range.
            last_us: its end.
        """
        with self._stored.consistent():
            chunks = self._stored.rows(
                "SELECT id FROM chunks WHERE last_us >= ? AND first_us <= ? ORDER BY first_us, id", (first_us, last_us)
            )
            stored = (self._from_chunk(chunk_id, wanted) for (chunk_id,) in chunks)
            for columns in chain([self._from_configs(wanted)], stored, [self._from_tail(wanted)]):
                if cut := _cut(columns, first_us, last_us):
                    yield Block(cut)

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

    def _from_chunk(self, chunk_id: int, wanted: Mapping[str, ElementArray]) -> list[BlockColumn]:
        rows = self._stored.rows(
            "SELECT c.id, c.track, c.ends, s.field, s.first_element, s.elements, s.dtype FROM series s"
            f" JOIN columns c ON c.id = ? + s.id WHERE s.field IN ({','.join('?' * len(wanted))}) ORDER BY s.id",
            (chunk_id * IDS_PER_CHUNK, *wanted),
        )
        tracks: dict[int, Track] = {}
        columns = []
        with self._stored.sound():
            for column_id, track_id, ends, field, first, count, dtype in rows:
                elements = _within(wanted[field], first, count)
                if not len(elements):
                    continue
                if track_id not in tracks:
                    tracks[track_id] = self._track(track_id)
                ranges = stream_ranges(ends, elements - first)
                start = ranges[0][0]
                data = self._stored.part_of_column(column_id, start, ranges[-1][1])
                streams = [data[low - start : high - start] for low, high in ranges]
                track = tracks[track_id]
                decode = partial(self._decode, streams, dtype, len(track.times_us))
                columns.append(BlockColumn(field, elements, track, decode))
        return columns

    def _decode(self, streams: list[bytes], dtype: str, n_samples: int) -> CountArray:
        with self._stored.sound():
            return unpack_streams(streams, dtype, n_samples)

    def _track(self, track_id: int) -> Track:
        query = "SELECT samples, times_us, instants FROM tracks WHERE id = ?"
        ((n, times, instants),) = self._stored.rows(query, (track_id,))
        times_us, of_master = (
            unpack_streams([packed], "<i8", n)[:, 0].astype(np.int64) for packed in (times, instants)
        )
        return Track(times_us, of_master)

    def _from_tail(self, wanted: Mapping[str, ElementArray]) -> list[BlockColumn]:
        tail = self._build_tail()
        columns = []
        for key, (number, counts) in tail.columns.items():
            if key.field in wanted:
                elements = _within(wanted[key.field], key.first_element, key.elements)
                choose = partial(np.take, counts, elements - key.first_element, axis=1)
                columns.append(BlockColumn(key.field, elements, tail.tracks[number], choose))
        return columns

    def _build_tail(self) -> Chunk:
        """Decode what came after the last chunk."""
        with self._stored.sound():
            return self._decode_tail()

    def _decode_tail(self) -> Chunk:
        stored = self._stored
        state = tuple(
            stored.last_id(table) for table in ("frames", "can_frames", "measurements", "estimates", "chunks")
        )
        if self._tail is None or self._tail[0] != state:
            last_chunk = stored.rows("SELECT last_frame, boots, last_uptime_ms FROM chunks ORDER BY id DESC LIMIT 1")
            last_frame, boots, last_uptime_ms = last_chunk[0] if last_chunk else (0, 0, None)
            ((last_us,),) = stored.rows("SELECT coalesce(max(last_us), ?) FROM chunks", (-_ALWAYS_US,))
            before = "SELECT t_mono_ns FROM frames WHERE id <= ? AND ok ORDER BY id DESC LIMIT 1"
            last_good = stored.rows(before, (last_frame,))
            with stored.sound():
                metadata = parse_object(meta_of(stored)["metadata"])
            builder = ChunkBuilder(
                boots,
                last_uptime_ms,
                last_good[0][0] if last_good else None,
                battery=self._battery,
                decodes_can=FOREIGN_CAN not in metadata,
                map_hash=self._map_hash,
            )
            can_frames = stored.iterate("can_frames", "t_mono_ns, can_id, data, bus", (last_us + 1) * 1000, None)
            builder.add(
                stored.rows("SELECT t_mono_ns, raw FROM frames WHERE id > ? AND ok ORDER BY id", (last_frame,)),
                (frame for *frame, bus in can_frames if not bus),  # type: ignore[misc]
                stored.rows("SELECT t_mono_ns, image FROM configs ORDER BY id"),
                stored.iterate("measurements", "t_mono_ns, numbers", (last_us + 1) * 1000, None),
            )
            for row in stored.rows("SELECT t_mono_ns, uptime_ms, soc, sigma FROM estimates ORDER BY id"):
                builder.add_estimate(*row)
            self._tail = (state, builder.build())
        return self._tail[1]

    def _from_configs(self, wanted: Mapping[str, ElementArray]) -> list[BlockColumn]:
        """Fields of the images in force, each from its time on, to the end of the session."""
        names = [name for name in wanted if name.startswith("conf.")]
        rows = self._stored.rows("SELECT t_mono_ns, image FROM configs ORDER BY id") if names else []
        if not rows:
            return []
        if self._map_hash == FIRST_MAP:  # a program of the present map recorded images of its own
            rows = [(t_mono_ns, first_image(image)) for t_mono_ns, image in rows]
        sampled, fields = self.fields(), fields_of(self._map_hash)
        last_frame = self._stored.rows("SELECT t_mono_ns FROM frames ORDER BY id DESC LIMIT 1")
        end_ns = max(row[0] for row in (rows[-1], *last_frame))
        times_us = np.array([*(row[0] for row in rows), end_ns], np.int64) // 1000
        track = Track(times_us, -times_us)
        columns = []
        for name in names:
            if name not in sampled:
                with self._stored.sound():
                    values = np.array([fields[name].unpack(image) for _, image in (*rows, rows[-1])], np.int64)
                columns.append(BlockColumn(name, wanted[name], track, partial(np.take, values, wanted[name], axis=1)))
        return columns


def _within(elements: ElementArray, first: int, count: int) -> ElementArray:
    return elements[(elements >= first) & (elements < first + count)]


def _cut(columns: list[BlockColumn], first_us: int, last_us: int) -> tuple[BlockColumn, ...]:
    """Columns in order of time and without what is out of range; those that had a track in common still have."""
    tracks: dict[int, tuple[Track, Any]] = {}
    cut = []
    for column in columns:
        times_us = column.track.times_us
        if id(column.track) not in tracks:
            keep: Any = slice(*np.searchsorted(times_us, (first_us, last_us + 1)))
            if (np.diff(times_us) < 0).any():
                keep = np.argsort(times_us, kind="stable")
                keep = keep[(times_us[keep] >= first_us) & (times_us[keep] <= last_us)]
            tracks[id(column.track)] = Track(times_us[keep], column.track.instants[keep]), keep
        track, keep = tracks[id(column.track)]
        if len(track.times_us) and len(column.elements):
            cut.append(column.cut(track, keep))
    return tuple(cut)


CARRIED_US = round(UNKNOWN_AGE_S * 1e6)  # longest age at the start of a range; older values are missing in it


def in_rows(
    blocks: Iterable[Block],
    wanted: Mapping[str, ElementArray],
    signals: Signals,
    source: DbcMapping | SerialMapping,
    first_us: int,
) -> Iterator[Block]:
    """Yield blocks in which all wanted elements share one track; rows in which nothing is known are left out.

    Args:
        blocks: in order of time, from CARRIED_US before the range.
        wanted: fields with their elements, ascending.
        signals: of the battery.
        source: gives the period of the rows, and the age from which a value is missing.
        first_us: start of the range.
    """
    ages_s = ages_of(source)
    first_of = {name: signals.of_field(name) for name in wanted}
    holders = {name: Holder(count, ages_s.get(name)) for name, (_, count) in first_of.items()}
    next_us = first_us
    for block in blocks:
        samples: dict[str, list[Samples]] = defaultdict(list)
        for column in block.columns:
            signal = first_of[column.field][0]
            values = signal.physical(np.ascontiguousarray(column.counts))
            samples[column.field].append((column.elements, column.track.times_us, values))
        grid_us = grid_of(max(next_us, block.first_us), block.last_us, round(source.period_s * 1e6))
        next_us = max(next_us, block.last_us + 1)
        period_us = round(source.period_s * 1e6)
        rows: dict[str, FloatArray] = {}
        for name, holder in holders.items():
            if name != IS_NEW:
                values, at_us = holder.rows_and_times(samples[name], grid_us)
                rows[name] = values[:, wanted[name]]
                if name == "v" and IS_NEW in wanted:
                    rows[IS_NEW] = (at_us > grid_us[:, None] - period_us).astype(np.float64)[:, wanted[IS_NEW]]
        is_known = np.any([np.isfinite(row).any(axis=1) for name, row in rows.items() if name != IS_NEW], axis=0)
        if not is_known.any():
            continue
        track = Track(grid_us[is_known], -grid_us[is_known])
        yield Block(
            tuple(
                BlockColumn(name, wanted[name], track, partial(np.asarray, values[is_known]))
                for name, values in rows.items()
                if np.isfinite(values).any()
            )
        )
