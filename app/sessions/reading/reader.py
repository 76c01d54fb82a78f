"""Reading a session, closed or not, also while it is being recorded. Changes nothing in it."""

import hashlib
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from heapq import merge
from pathlib import Path
from typing import Any

import numpy as np

from app.battery.battery import Battery
from app.errors import ConfigError, ExtraMissing, ImportFailed, LimitExceeded, WorkerEnded
from app.estimation.arrays import FloatArray
from app.sessions.errors import NotASession
from app.sessions.info import Marker, RecordedCanFrame, RecordedConfig, RecordedFrame, SessionInfo
from app.sessions.reading.blocks import CARRIED_US, Block, BlockColumn, BlockReader, ElementArray
from app.sessions.reading.blocks import in_rows as rows_of
from app.sessions.reading.check import find_problems
from app.sessions.reading.parse import Parse, in_process
from app.sessions.reading.series import FieldSamples, SeriesSamples, SessionSeries, joined, reduce_samples
from app.sessions.reading.session_info import filled_spans, info_of, meta_of, read_note, wall_offset_ns
from app.sessions.reading.whole_totals import with_whole_totals
from app.sessions.storage.chunks import ESTIMATES, Track
from app.sessions.storage.digests import KEY
from app.sessions.storage.queries import StoredSession
from app.sessions.storage.signals import Signals, StoredSignal
from app.sources.items import TableItem
from app.sources.loaded_battery import LoadedBattery, battery_from_files, team_battery
from app.words import Message, condition_of
from firmware_protocol.memory_map import FIELDS, N_CELLS
from firmware_protocol.older_maps import FIRST_MAP, fields_of, present_image

MAX_POINTS = 100_000
OnRead = Callable[[int, int], None]  # parts read, parts in all
Received = RecordedFrame | RecordedCanFrame | RecordedConfig | TableItem
MOST_FILES = 50  # files of a battery
MOST_FILE_BYTES = 32 << 20
_ALWAYS_US = 1 << 62


class SessionFile:
    """One session, opened for reading, by any thread; times in seconds are unix time.

    Unix time is the monotonic clock put onto the wall clock as it was last known, so a step of the wall clock in the
    middle of a session moves no sample against another.
    """

    def __init__(self, path: Path, on_read: OnRead | None = None, parse: Parse = in_process) -> None:
        """Open the file.

        Args:
            path: of the file.
            on_read: called with how far it is read, by what reads fields from begin to end.
            parse: how the texts that the file brings along, battery and cell file, are parsed.

        Raises:
            NotASession: missing, damaged, or something else. Every method raises this where it meets damage.
            SchemaTooNew: a newer program wrote it.
        """
        self.path = path
        self._on_read = on_read
        self.parse = parse
        self._stored = StoredSession(path)
        try:
            self.loaded_battery = self._load_battery()
            meta = self._meta()
            self._offset_ns = wall_offset_ns(self._stored, meta)
            self._map_hash = meta["map_hash"]
        except BaseException:
            self._stored.close()
            raise

        self._blocks = BlockReader(self._stored, self.loaded_battery, self._map_hash)
        self.signals = Signals(self.loaded_battery, self._map_hash)

    def __enter__(self) -> "SessionFile":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._stored.close()

    def consistent(self) -> AbstractContextManager[None]:
        """Everything read inside is of one instant, whatever is recorded meanwhile."""
        return self._stored.consistent()

    @property
    def info(self) -> SessionInfo:
        """Return the facts of the session; quick however long it is."""
        return info_of(self._stored)

    @property
    def battery(self) -> Battery:
        """The battery that was recorded."""
        return self.loaded_battery.battery

    @property
    def cell_file(self) -> str | None:
        """Text of the cell file that the session was estimated with; None in sessions of earlier versions."""
        return self._meta().get("cell_file")

    @property
    def content_digest(self) -> str:
        """SHA-256 over what was recorded, in hex; tags and notes are not in it. Of a session of old: over its file."""
        digests = self._meta().get(KEY)
        if digests is not None:
            return hashlib.sha256(digests.encode()).hexdigest()
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def unix_s(self, t_mono_ns: int) -> float:
        """Return the unix time of an instant of the recording machine's monotonic clock."""
        return (t_mono_ns + self._offset_ns) / 1e9

    def filled(self) -> list[tuple[float, float]]:
        """Spans in unix time that came from another recorder of the same run."""
        info = self.info
        start_s = info.started_wall_ns / 1e9
        return [(start_s + first, start_s + last) for first, last in filled_spans(info)]

    def uptimes(self, until_ns: int) -> list[tuple[int, int]]:
        """Return when frames arrived [ns, monotonic] and what the master's clock showed [ms], every ten seconds."""
        return self._stored.rows(
            "SELECT t_mono_ns, uptime_ms FROM clock WHERE uptime_ms NOTNULL AND t_mono_ns < ? ORDER BY id", (until_ns,)
        )

    def mono_us(self, unix_s: float) -> int:
        """Return the monotonic time of a unix time, to the microsecond, which is what a float can tell apart."""
        return round((round(unix_s * 1e9) - self._offset_ns) / 1000)

    def frames(self, t_from_s: float | None = None, t_to_s: float | None = None) -> Iterator[RecordedFrame]:
        """Yield the serial frames of a range, both ends included, as received and in that order."""
        first_ns, last_ns = self._range_ns(t_from_s, t_to_s)
        for row in self._stored.iterate("frames", "t_mono_ns, t_wall_ns, link, raw, ok", first_ns, last_ns):
            yield RecordedFrame(row[0], row[1], row[2], row[3], bool(row[4]))

    def can_frames(
        self, t_from_s: float | None = None, t_to_s: float | None = None, *, all_buses: bool = False
    ) -> Iterator[RecordedCanFrame]:
        """Yield the CAN frames of a range, both ends included, in order; those of the battery's own bus, or all."""
        first_ns, last_ns = self._range_ns(t_from_s, t_to_s)
        for row in self._stored.iterate("can_frames", "t_mono_ns, t_wall_ns, can_id, data, bus", first_ns, last_ns):
            frame = RecordedCanFrame(*row)
            if all_buses or frame.bus == 0:
                yield frame

    def measurements(self, t_from_s: float | None = None, t_to_s: float | None = None) -> Iterator[TableItem]:
        """Yield the rows of an imported table in a range, both ends included, in order."""
        columns = "t_mono_ns, t_wall_ns, numbers"
        for t_mono_ns, t_wall_ns, numbers in self._stored.iterate(
            "measurements", columns, *self._range_ns(t_from_s, t_to_s)
        ):
            with self._stored.sound():
                yield TableItem(t_mono_ns, t_wall_ns, np.frombuffer(numbers, "<f8"))

    def count_can_frames(self, t_from_s: float | None = None, t_to_s: float | None = None) -> int:
        """Return how many CAN frames are in a range, both ends included."""
        return self._stored.count("can_frames", *self._range_ns(t_from_s, t_to_s))

    def configs(self) -> list[RecordedConfig]:
        """Every configuration in force, in order, in the present memory map."""
        recorded = self.configs_as_recorded()
        if self._map_hash != FIRST_MAP:
            return recorded
        return [replace(config, image=present_image(config.image)) for config in recorded]

    def configs_as_recorded(self) -> list[RecordedConfig]:
        """Every configuration in force, in order, as it stands in the file: in the session's memory map or our own."""
        rows = self._stored.table("configs")
        return [RecordedConfig(row["t_mono_ns"], row["t_wall_ns"], row["why"], row["image"]) for row in rows]

    def received(self, t_from_s: float | None = None, t_to_s: float | None = None) -> Iterator[Received]:
        """Yield everything that was received, in order of arrival; all configurations, whatever the range."""
        sources: list[Iterable[Received]] = [
            self.configs(),
            self.frames(t_from_s, t_to_s),
            self.can_frames(t_from_s, t_to_s),
            self.measurements(t_from_s, t_to_s),
        ]
        yield from merge(*sources, key=lambda item: item.t_mono_ns)

    def bad_frames(self) -> int:
        """Return the number of damaged serial frames."""
        with self.consistent():
            ((stored, last),) = self._stored.rows(
                "SELECT coalesce(sum(bad_frames), 0), coalesce(max(last_frame), 0) FROM chunks"
            )
            ((tail,),) = self._stored.rows("SELECT count(*) FROM frames WHERE id > ? AND NOT ok", (last,))
        return int(stored) + int(tail)

    def estimates(
        self, t_from_s: float | None = None, t_to_s: float | None = None
    ) -> Iterator[tuple[int, int, FloatArray, FloatArray]]:
        """Yield the estimates of a range: monotonic time [ns], the master's clock [ms], (n_cells,) SOC and sigma."""
        n_cells = self.battery.n_cells
        wanted = [self.signals.find(f"{name}[{cell}]") for name in ESTIMATES for cell in range(n_cells)]
        for block in self.blocks(wanted, t_from_s, t_to_s):
            column_of = {column.field: column for column in block.columns}
            if len(column_of) == len(ESTIMATES):
                track = column_of[ESTIMATES[0]].track
                values = [wanted[0].physical(column_of[name].counts) for name in ESTIMATES]
                times_ns = track.times_us * 1000
                uptimes_ms = np.where(track.instants < 0, times_ns // 1_000_000, track.instants & 0xFFFFFFFF)
                yield from zip(times_ns.tolist(), uptimes_ms.tolist(), *values, strict=True)

    def markers(self) -> list[Marker]:
        """All markers, in order."""
        return [Marker(**row) for row in self._stored.table("markers")]

    def events(self) -> list[dict[str, Any]]:
        """All events of the session, in order, each with the columns of the table `events` and today's code."""
        return [row | {"code": condition_of(row["code"])} for row in self._stored.table("events")]

    def series(
        self,
        signals: Sequence[str],
        t_from_s: float | None = None,
        t_to_s: float | None = None,
        points: int = 2000,
    ) -> dict[str, SessionSeries]:
        """Return each signal over a range with smallest and largest value per point.

        Raises:
            UnknownSignal: a name means nothing.
            ValueError: `points` is not within 1..MAX_POINTS.
        """
        if not 1 <= points <= MAX_POINTS:
            raise ValueError(f"points = {points}: 1..{MAX_POINTS}")
        chosen = [self.signals.find(name) for name in signals]
        result = {}
        for signal, samples in zip(chosen, self.samples(chosen, t_from_s, t_to_s), strict=True):
            times_s = (samples.track.times_us * 1000 + self._offset_ns) / 1e9
            values = signal.physical(samples.counts)
            result[signal.name] = reduce_samples(signal.name, signal.unit, times_s, values, points)
        return result

    def samples(
        self, signals: Sequence[StoredSignal], t_from_s: float | None = None, t_to_s: float | None = None
    ) -> list[SeriesSamples]:
        """Return every sample of each signal in a range, ends included."""
        parts: dict[tuple[str, int], list[tuple[BlockColumn, int]]] = defaultdict(list)
        for block in self.blocks(signals, t_from_s, t_to_s):
            for column in block.columns:
                for i, element in enumerate(column.elements.tolist()):
                    parts[column.field, element].append((column, i))
        tracks: dict[tuple[int, ...], tuple[Track, Any]] = {}
        samples = []
        for signal in signals:
            columns = parts[signal.field, signal.element]
            key = tuple(id(column.track) for column, _ in columns)
            if key not in tracks:
                tracks[key] = joined([column.track for column, _ in columns])
            track, order = tracks[key]
            samples.append(SeriesSamples(track, columns, order))
        return samples

    def blocks(
        self,
        signals: Iterable[StoredSignal],
        t_from_s: float | None = None,
        t_to_s: float | None = None,
        *,
        in_rows: bool = False,
    ) -> Iterator[Block]:
        """Yield the samples of signals in a range, about a minute at a time, in order of time; ends included.

        Everything that reads more than a few samples reads them here. What is recorded meanwhile is not seen.
        A battery with a DBC tells each value at its own time; with `in_rows` all have the same times, one a period.
        """
        elements: dict[str, set[int]] = defaultdict(set)
        for signal in signals:
            elements[signal.field].add(signal.element)
        wanted = {name: np.array(sorted(elements_of_field), np.intp) for name, elements_of_field in elements.items()}
        return self._read(wanted, t_from_s, t_to_s, in_rows=in_rows)

    def fields(
        self, names: Sequence[str], t_from_s: float | None = None, t_to_s: float | None = None
    ) -> Iterator[dict[str, FieldSamples]]:
        """Yield the blocks of whole fields in units. A field of which a block holds nothing is not in it.

        A field of the team's memory map that this battery does not tell is passed over.

        Raises:
            UnknownSignal: a name is no field and no estimate.
        """
        order = self.signals.order
        shapes = {name: self.signals.of_field(name) for name in names if name in order or name not in FIELDS}
        wanted = {name: np.arange(count) for name, (_, count) in shapes.items()}
        for block in self._read(wanted, t_from_s, t_to_s, in_rows=True):
            if self._on_read is not None and t_from_s is t_to_s is None:
                self._tell(block, self._on_read)
            columns: dict[str, list[BlockColumn]] = defaultdict(list)
            for column in block.columns:
                columns[column.field].append(column)
            yield {name: self._in_units(parts, *shapes[name]) for name, parts in columns.items()}

    def _read(
        self, wanted: Mapping[str, ElementArray], t_from_s: float | None, t_to_s: float | None, *, in_rows: bool
    ) -> Iterator[Block]:
        first_us = -_ALWAYS_US if t_from_s is None else self.mono_us(t_from_s)
        last_us = _ALWAYS_US if t_to_s is None else self.mono_us(t_to_s)
        mapping = self.loaded_battery.mapping if in_rows else None
        if self.loaded_battery.has_memory_map:
            return with_whole_totals(
                lambda elements_of: self._blocks.blocks(elements_of, first_us, last_us), wanted, N_CELLS
            )
        if mapping is None:
            return self._blocks.blocks(wanted, first_us, last_us)
        blocks = self._blocks.blocks(wanted, first_us - CARRIED_US, last_us)
        return rows_of(blocks, wanted, self.signals, mapping, first_us)

    def _tell(self, block: Block, on_read: OnRead) -> None:
        start_us, end_us = (time_ns // 1000 for time_ns in (self.info.started_mono_ns, self.info.ended_mono_ns or 0))
        on_read(min(block.last_us, end_us) - start_us, end_us - start_us)

    def _in_units(self, parts: Sequence[BlockColumn], signal: StoredSignal, n_elements: int) -> FieldSamples:
        """Columns of one field as one table."""
        track, order = joined([part.track for part in parts])
        tables = []
        for part in parts:
            values = signal.physical(np.ascontiguousarray(part.counts))
            if len(part.elements) < n_elements:
                of_part, values = values, np.full((len(values), n_elements), np.nan)
                values[:, part.elements] = of_part
            tables.append(values)
        return FieldSamples(
            (track.times_us * 1000 + self._offset_ns) / 1e9,
            (tables[0] if len(tables) == 1 else np.concatenate(tables))[order],
        )

    def note(self, key: str) -> Any:
        """Return a note that somebody added to the session afterwards; None without one."""
        return read_note(self._stored, key)

    def chunk_spans_us(self) -> list[tuple[int, int]]:
        """First and last sample time of each stored chunk and of what came after them, monotonic microseconds."""
        return self._blocks.spans_us()

    def signal_names(self) -> list[str]:
        """Fields and estimates of which the session holds samples, without indices, in their usual order."""
        with self.consistent():
            names = self._blocks.fields()
            if self._stored.last_id("configs"):
                names |= {name for name in fields_of(self._map_hash) if name.startswith("conf.")}
        order = self.signals.order
        return sorted(names, key=lambda name: (order.get(name, len(order)), name))

    def problems(self) -> list[str]:
        """Look at every byte; an empty list is a sound file. Takes seconds for a long session."""
        return find_problems(self._stored, self._on_read)

    def copy_to(self, path: Path) -> None:
        """Write the session as one file without a log, complete up to now."""
        self._stored.backup(path)

    def _meta(self) -> dict[str, str]:
        return meta_of(self._stored)

    def _load_battery(self) -> LoadedBattery:
        """The battery that the file explains; the team's own where it explains none."""
        if not self._stored.rows("SELECT 1 FROM sqlite_master WHERE name = 'battery_files'"):
            return team_battery()
        ((count, size),) = self._stored.rows("SELECT count(*), total(length(CAST(data AS BLOB))) FROM battery_files")
        if count > MOST_FILES or size > MOST_FILE_BYTES:
            raise NotASession(str(self.path), Message("session-battery-large", files=MOST_FILES, bytes=MOST_FILE_BYTES))
        files = {row["name"]: row["data"] for row in self._stored.table("battery_files")}
        try:
            with self._stored.sound():
                return self.parse(battery_from_files, files) if files else team_battery()
        except (ConfigError, ImportFailed, ExtraMissing, LimitExceeded, WorkerEnded) as error:
            raise NotASession(str(self.path), error.message) from error  # also of a version that is not understood
        except RecursionError as error:
            raise NotASession(str(self.path), Message("limit-nesting", limit=sys.getrecursionlimit())) from error

    def _range_ns(self, t_from_s: float | None, t_to_s: float | None) -> tuple[int | None, int | None]:
        first_ns = None if t_from_s is None else self.mono_us(t_from_s) * 1000 - 500
        last_ns = None if t_to_s is None else self.mono_us(t_to_s) * 1000 + 500
        return first_ns, last_ns
