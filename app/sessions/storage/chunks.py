"""Frames and estimates of about a minute to columns: numbers per signal over shared sample times.

The recorder closes a chunk a minute; the reader builds one for what came after the last one. Pure, no I/O.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from heapq import merge
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.sessions.storage.battery_columns import BatteryColumns, TableColumns
from app.sessions.storage.streams import CountArray
from app.sources.loaded_battery import LoadedBattery, team_battery
from firmware_protocol.can_tables import TableReader
from firmware_protocol.config_image import default_image
from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import Frame, decode_chunk
from firmware_protocol.messages import Data, MessageType
from firmware_protocol.older_maps import fields_of

ESTIMATE_SCALE = 2e-5  # per count of a stored estimate; 65535 is missing
ESTIMATE_MISSING = 0xFFFF
ESTIMATES = ("estimate.soc", "estimate.soc_sigma")
FOREIGN_CAN = "foreign_can"  # in a session's metadata: its CAN frames are not of our master
SERIAL_LIVE_NS = 1_000_000_000  # a serial frame not longer ago: CAN carries the same memory, less of it
_RESET_MS = 1000  # the master's clock went back by more than this: it has booted
_NUMPY_TYPES = {"b": "|i1", "B": "|u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4"}
Layout = tuple[tuple[int, int], ...]  # offset and length of each window


@dataclass(frozen=True, slots=True)
class SeriesKey:
    """Key of a column block: consecutive elements of one field, as counts, or as values of type `<f8`."""

    field: str
    first_element: int
    elements: int
    dtype: str


@dataclass(frozen=True, slots=True)
class Track:
    """Times that some columns share: microseconds of the monotonic clock, and boot * 2**32 + uptime_ms.

    What came over CAN has no part in the master's clock: its instants are its times, negative.
    """

    times_us: NDArray[np.int64]
    instants: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Chunk:
    """Decoded samples: for each key the number of its track and (samples, elements) counts."""

    tracks: tuple[Track, ...]
    columns: dict[SeriesKey, tuple[int, CountArray]]

    @property
    def span_us(self) -> tuple[int, int]:
        """First and last sample time, (0, -1) without any."""
        if not self.tracks:
            return 0, -1
        return min(int(t.times_us[0]) for t in self.tracks), max(int(t.times_us[-1]) for t in self.tracks)


def encode_estimate(values: NDArray[np.float64]) -> bytes:
    """Return fractions as counts: not finite is missing, below 0 is 0."""
    is_finite = np.isfinite(values)
    counts = np.clip(np.where(is_finite, values, 0.0) / ESTIMATE_SCALE, 0, ESTIMATE_MISSING - 1).round()
    return np.where(is_finite, counts, ESTIMATE_MISSING).astype("<u2").tobytes()


@lru_cache(maxsize=256)
def _segments(layout: Layout, map_hash: str | None = None) -> tuple[tuple[SeriesKey, int], ...]:
    """What whole elements of a map the windows carry and where in their joined bytes each run of them starts."""
    segments = []
    position = 0
    for offset, length in layout:
        for placed in fields_of(map_hash).values():
            size = placed.item_size
            first = max(0, -(-(offset - placed.offset) // size))
            last = min(placed.count, (offset + length - placed.offset) // size)
            if first < last:
                start = position + placed.offset + first * size - offset
                segments.append((SeriesKey(placed.name, first, last - first, _NUMPY_TYPES[placed.fmt]), start))
        position += length
    return tuple(segments)


@dataclass(slots=True)
class _Group:
    """Frames of one layout: their place in the chunk's list of times and their windows' bytes."""

    indices: list[int] = field(default_factory=list)
    bodies: list[bytes] = field(default_factory=list)


class ChunkBuilder:
    """Collects what was received; `build` gives the columns."""

    def __init__(
        self,
        boots: int = 0,
        last_uptime_ms: int | None = None,
        last_frame_ns: int | None = None,
        *,
        battery: LoadedBattery | None = None,
        decodes_can: bool = True,
        map_hash: str | None = None,
    ) -> None:
        """Begin with the master's clock as it was; a battery with a DBC has none.

        Args:
            boots: how often that clock had gone back.
            last_uptime_ms: what it showed last.
            last_frame_ns: when the last frame arrived.
            battery: None is the team's own.
            decodes_can: whether CAN frames are of our master.
            map_hash: of the memory map that was recorded; None is the present one.
        """
        battery = battery or team_battery()
        mapping = battery.mapping
        self._battery = None if mapping is None else BatteryColumns(battery.battery, mapping, battery.definitions)
        self._table = TableColumns(battery.battery) if battery.kind == "table" else None
        self._is_serial = battery.serial is not None
        self._n_cells = battery.battery.n_cells
        self._boots = boots
        self._last_uptime_ms = last_uptime_ms
        self._last_frame_ns = last_frame_ns
        self._decodes_can = decodes_can
        self.map_hash = map_hash
        self._can_tables: TableReader | None = None  # those of a new master, until a configuration says others
        self._restart()

    def _restart(self) -> None:
        self._groups: dict[Layout, _Group] = defaultdict(_Group)
        self._times_us: list[int] = []
        self._instants: list[int] = []
        self._estimates: list[bytes] = []
        self._estimate_times_us: list[int] = []
        self._estimate_uptimes_ms: list[int] = []
        self._boots_at_start = self._boots

    def __len__(self) -> int:
        of_others = sum(len(part) for part in (self._battery, self._table) if part is not None)
        return len(self._times_us) + len(self._estimate_times_us) + of_others

    @property
    def master_clock(self) -> tuple[int, int | None]:
        """Return how often the master's clock has gone back, and its value in the last intact frame [ms]."""
        return self._boots, self._last_uptime_ms

    @property
    def bad_checksums(self) -> int:
        """CAN frames whose checksum, by the battery's profile, does not fit."""
        return 0 if self._battery is None else self._battery.bad_checksums

    @property
    def absent_values(self) -> int:
        """Temperatures of sensors that are not connected."""
        return 0 if self._battery is None else self._battery.absent_values

    def add(
        self,
        frames: Iterable[tuple[int, bytes]],
        can_frames: Iterable[tuple[int, int, bytes]] = (),
        configs: Iterable[tuple[int, bytes]] = (),
        measurements: Iterable[tuple[int, bytes]] = (),
    ) -> None:
        """Take what was received, each kind in order: (t_mono_ns, raw), (t_mono_ns, id, data), (t_mono_ns, image).

        `measurements` are (t_mono_ns, numbers), rows of a table, whose session has CAN frames that nobody decodes.
        """
        if self._table is not None:
            self._table.add_all(measurements)
            return
        if self._battery is not None:
            self._battery.add_all(((t_ns, 0, raw) for t_ns, raw in frames) if self._is_serial else can_frames)
            return
        kinds: tuple[tuple[Iterable[tuple[Any, ...]], Callable[..., None]], ...] = (
            (configs, self._use_tables),
            (can_frames, self.add_can_frame),
            (frames, self.add_frame),
        )
        sources = [[(item[0], take, item) for item in items] for items, take in kinds]
        for _, take, item in merge(*sources, key=itemgetter(0)):
            take(*item)

    def _use_tables(self, _: int, image: bytes) -> None:
        self._can_tables = TableReader(image)

    def add_can_frame(self, t_mono_ns: int, can_id: int, data: bytes) -> None:
        """Take a CAN frame: what it tells about the struct by the tables in force, where no serial frame tells more."""
        if not self._decodes_can:
            return
        if self._last_frame_ns is not None and t_mono_ns - self._last_frame_ns < SERIAL_LIVE_NS:
            return
        if self._can_tables is None:
            self._can_tables = TableReader(default_image())
        windows = self._can_tables.windows(can_id, data)
        layout = tuple((w.offset, len(w.data)) for w in windows)
        if _segments(layout, self.map_hash):
            self._append(layout, b"".join([w.data for w in windows]), t_mono_ns, -(t_mono_ns // 1000))

    def add_frame(self, t_mono_ns: int, raw: bytes) -> None:
        """Take an intact frame; one without telemetry only moves the master's clock on."""
        frame = decode_chunk(raw)
        if not isinstance(frame, Frame):
            return
        self._last_frame_ns = t_mono_ns
        if self._last_uptime_ms is not None and frame.uptime_ms < self._last_uptime_ms - _RESET_MS:
            self._boots += 1
        self._last_uptime_ms = frame.uptime_ms
        if frame.type != MessageType.DATA:
            return
        try:
            windows = Data.from_body(frame.body).windows
        except DecodeError:
            return
        layout = tuple((w.offset, len(w.data)) for w in windows)
        body = b"".join([w.data for w in windows])
        self._append(layout, body, t_mono_ns, self._boots << 32 | frame.uptime_ms)

    def _append(self, layout: Layout, body: bytes, t_mono_ns: int, instant: int) -> None:
        group = self._groups[layout]
        group.indices.append(len(self._times_us))
        group.bodies.append(body)
        self._times_us.append(t_mono_ns // 1000)
        self._instants.append(instant)

    def add_estimate(self, t_mono_ns: int, uptime_ms: int, soc: bytes, sigma: bytes) -> None:
        """Take one estimate of all cells, as `encode_estimate` made it."""
        self._estimates.append(soc + sigma)
        self._estimate_times_us.append(t_mono_ns // 1000)
        self._estimate_uptimes_ms.append(uptime_ms)

    def build(self) -> Chunk:
        """Return all that was added, as columns."""
        tracks: list[Track] = []
        numbers: dict[bytes, int] = {}
        columns: dict[SeriesKey, tuple[int, CountArray]] = {}
        parts: dict[SeriesKey, list[tuple[NDArray[np.int64], CountArray]]] = defaultdict(list)
        for layout, group in self._groups.items():
            indices = np.array(group.indices)
            image = np.frombuffer(b"".join(group.bodies), np.uint8).reshape(len(indices), -1)
            for key, start in _segments(layout, self.map_hash):
                size = np.dtype(key.dtype).itemsize * key.elements
                values = np.ascontiguousarray(image[:, start : start + size]).view(key.dtype)
                parts[key].append((indices, values))
        times_us, instants = np.array(self._times_us, np.int64), np.array(self._instants, np.int64)
        for key, pieces in parts.items():
            indices = np.concatenate([piece[0] for piece in pieces])
            order = np.argsort(indices, kind="stable")
            indices = indices[order]
            values = np.concatenate([piece[1] for piece in pieces])[order]
            number = numbers.setdefault(indices.tobytes(), len(tracks))
            if number == len(tracks):
                tracks.append(Track(times_us[indices], instants[indices]))
            columns[key] = (number, values)
        of_others = self._table if self._battery is None else self._battery
        for column in [] if of_others is None else of_others.build():
            number = numbers.setdefault(column.times_us.tobytes(), len(tracks))
            if number == len(tracks):
                tracks.append(Track(column.times_us, -column.times_us))
            key = SeriesKey(column.field, column.first_element, column.values.shape[1], "<f8")
            columns[key] = (number, column.values)
        if self._estimates:
            n = self._n_cells
            matrix = np.frombuffer(b"".join(self._estimates), "<u2").reshape(-1, 2 * n)
            for i, name in enumerate(ESTIMATES):
                columns[SeriesKey(name, 0, n, "<u2")] = (
                    len(tracks),
                    np.ascontiguousarray(matrix[:, i * n : (i + 1) * n]),
                )
            tracks.append(self._estimate_track(times_us, instants))
        return Chunk(tuple(tracks), columns)

    def _estimate_track(self, times_us: NDArray[np.int64], instants: NDArray[np.int64]) -> Track:
        """Give each estimate the boot of the last frame before it, or the one before, where the uptime says so."""
        own_us = np.array(self._estimate_times_us, np.int64)
        if self._table is not None:
            return Track(own_us, -own_us)  # as its rows
        by_master = instants >= 0
        times_us, instants = times_us[by_master], instants[by_master]
        uptimes_ms = np.array(self._estimate_uptimes_ms, np.int64)
        instants_from_start = np.insert(instants, 0, self._boots_at_start << 32 | 0xFFFFFFFF)
        before = instants_from_start[np.searchsorted(times_us, own_us, side="right")]
        boots = (before >> 32) - (uptimes_ms > (before & 0xFFFFFFFF) + _RESET_MS)
        return Track(own_us, np.maximum(boots, 0) << 32 | uptimes_ms)

    def clear(self) -> None:
        """Forget what was added; the master's clock goes on."""
        self._restart()
        for part in (self._battery, self._table):
            if part is not None:
                part.clear()
