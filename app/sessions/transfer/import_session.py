"""Makes a session of another system's recording: estimated by our filter, read like any other session."""

import errno
import os
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from heapq import merge
from operator import attrgetter
from pathlib import Path

from app import __version__
from app.errors import ImportFailed
from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.live.pipeline import Output, Pipeline
from app.sessions.info import UNDATED, SessionInfo
from app.sessions.recording.session_writer import SessionWriter, TableRow, event_row
from app.sessions.storage.database import code_of
from app.sessions.storage.files import new_file, remove
from app.sessions.transfer.frame_spool import FrameSpool
from app.sources.items import CanItem, TableItem
from app.sources.loaded_battery import LoadedBattery, team_battery
from app.sources.recordings.bad_rows import BadRows
from app.sources.recordings.battery_log import BatteryLog, battery_log
from app.sources.recordings.buses import Buses
from app.sources.recordings.can_log import read_frames
from app.sources.recordings.clock import LogClock
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.kind import is_can_log
from app.sources.recordings.log_signals import column_mapping, read_signals
from app.sources.recordings.origin import is_simulated_log, is_simulated_table
from app.sources.recordings.table import Table, read_table
from app.sources.table_source import battery_of_table, numbers_of_rows
from app.words import Message
from firmware_protocol.memory_map import MAP_HASH

START_MONO_NS = 10**9  # such a recording has no monotonic clock; its time axis begins here
BATCH = 2000  # rows
PARTS = 1000  # steps of an import's progress
READING = 0.1  # share of an import's time for reading a log
READING_TABLE = 0.02  # and that of a table
DECODING = 0.2  # is over when a log's frames are decoded by a DBC, too
LATEST_UNIX_S = 4_102_444_800  # 2100
Progress = Callable[[int, int], None]  # parts done, parts in all
NewPipeline = Callable[[LoadedBattery], Pipeline]


@dataclass(frozen=True, slots=True)
class ImportedSession:
    """The session made by an import; rows of a table, frames of a log."""

    info: SessionInfo
    rows: int
    cells: int
    notes: tuple[Message, ...]


@dataclass(frozen=True, slots=True)
class _Recording:
    """What is written: the spooled frames of a log, and the rows of a table, in order of time."""

    battery: LoadedBattery
    started_unix_s: float | None
    length_ns: int
    is_simulated: bool
    log: BatteryLog | None = None
    later_ns: int = 0  # from the first frame to the first row
    notes: tuple[Message, ...] = ()
    begun: float = READING  # the share of the import's time that it took


def import_file(
    path: Path,
    mapping: ImportMapping,
    folder: Path,
    new_pipeline: NewPipeline,
    *,
    battery: LoadedBattery | None = None,
    dbc: Path | None = None,
    table: Table | None = None,
    name: str = "",
    started_unix_s: float | None = None,
    on_progress: Progress = lambda done, of: None,
) -> ImportedSession:
    """Read a recording, run the filter over it and write it as a session into `folder`.

    Args:
        path: a table or a CAN log, known by its content (`app.sources.recordings.kind`).
        mapping: which columns, or signals of `dbc`, are what.
        folder: of the sessions.
        new_pipeline: makes a fresh chain with the filter and the cell to use.
        battery: who sent the frames of a CAN log, or whose shape a table has; None: the team's own, or one pack.
        dbc: of the CAN log's bus; then its signals are taken as a table by `profile`.
        table: what is in the file, where that is known; else it is read.
        name: of the session; the file's where empty.
        started_unix_s: where the file does not say; else the time at which the file was changed, less its length.
        on_progress: called with how far it is.

    Raises:
        ImportFailed, ExtraMissing: the file, the profile and the DBC do not go together; nothing is left behind.
        OSError: the disk is full, or refuses the session; nothing is left behind.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with closing(FrameSpool(folder)) as spool:
        recording = _read(path, mapping, battery, dbc, table, spool, on_progress)
        length_s = recording.length_ns / 1e9
        start_s = started_unix_s if started_unix_s is not None else recording.started_unix_s
        metadata: dict[str, object] = {"imported_from": path.name}
        if recording.is_simulated:
            metadata["source"] = "simulator"
        if start_s is None:
            start_s = path.stat().st_mtime - length_s
            metadata[UNDATED] = True
            recording = replace(recording, notes=(*recording.notes, Message("start-by-file-change")))
        if not 0 <= start_s < LATEST_UNIX_S:
            raise ImportFailed(path.name, Message("begins-impossibly", start=f"{start_s:.0f}"))
        wall_ns = round(start_s * 1e9)
        target = new_file(folder, wall_ns)
        info = SessionInfo(
            id=target.stem,
            path=target,
            name=name or path.name,
            started_wall_ns=wall_ns,
            started_mono_ns=START_MONO_NS,
            voltwall=__version__,
            map_hash=MAP_HASH.hex(),
            metadata=metadata,
        )
        try:
            return _write(info, recording, spool, new_pipeline(recording.battery), on_progress)
        except BaseException as error:
            remove(target)
            if isinstance(error, sqlite3.OperationalError) and code_of(error) == sqlite3.SQLITE_FULL:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target)) from error
            raise


def between(on_progress: Progress, start: float, end: float) -> Progress:
    """Return what tells the progress of a step as that of the import; it takes from start to end of it, 0..1."""
    return lambda done, of: on_progress(round(PARTS * (start + (end - start) * done / max(of, 1))), PARTS)


def _read(
    path: Path,
    mapping: ImportMapping,
    battery: LoadedBattery | None,
    dbc: Path | None,
    table: Table | None,
    spool: FrameSpool,
    on_progress: Progress,
) -> _Recording:
    """Read the file, once; its frames go into the spool."""
    if not is_can_log(path):
        table = table or read_table(path, between(on_progress, 0.0, READING_TABLE))
        log, is_simulated = battery_log(table, mapping), is_simulated_table(table)
        of_table, length_ns = battery_of_table(log, path.name, battery), round(log.time_s[-1] * 1e9)
        return _Recording(of_table, log.started_unix_s, length_ns, is_simulated, log, 0, log.notes, READING_TABLE)
    size, is_simulated = max(path.stat().st_size, 1), is_simulated_log(path)
    reading, clock = between(on_progress, 0.0, READING if dbc is None else DECODING), LogClock()
    if dbc is None:
        bad, buses = BadRows(), Buses(mapping.bus)
        for frame in read_frames(path, bad, lambda at: reading(at, size), clock, buses):
            spool.add(frame)
        buses.check(path.name, () if battery is None else battery.definitions.by_id())
        notes = (*bad.notes(spool.n), *clock.notes)
    else:
        signals = read_signals(
            path, dbc, on_read=lambda at: reading(at, size), on_frame=spool.add, clock=clock, bus=mapping.bus
        )
    if not spool.n:
        raise ImportFailed(path.name, Message("no-data-frame"))
    started_s = clock.started_unix_s(spool.first_s)
    length_ns = round((spool.last_s - spool.first_s) * 1e9)
    if dbc is None:
        return _Recording(battery or team_battery(), started_s, length_ns, is_simulated, notes=notes)
    mapping = replace(mapping, **column_mapping(mapping))  # type: ignore[arg-type]
    log = battery_log(signals.table(mapping), mapping)
    later_ns = round((log.first_s - spool.first_s) * 1e9)
    length_ns = max(length_ns, round(log.time_s[-1] * 1e9) + later_ns)
    of_table = battery_of_table(log, path.name, battery)
    started_s = started_s or log.started_unix_s
    return _Recording(of_table, started_s, length_ns, is_simulated, log, later_ns, log.notes, DECODING)


def _write(
    info: SessionInfo, recording: _Recording, spool: FrameSpool, pipeline: Pipeline, on_progress: Progress
) -> ImportedSession:
    """Write a session of frames and rows with what the pipeline makes of them."""
    writer = SessionWriter(info, format_cell(load_cell(pipeline.cell_name)), recording.battery)
    writing, log, done, written, newest_ns = between(on_progress, recording.begun, 1.0), recording.log, 0, 0, 0
    of = spool.n + (0 if log is None else len(log.time_s))
    end_ns, end_wall_ns = START_MONO_NS + recording.length_ns, info.started_wall_ns + recording.length_ns
    segments = recording.battery.battery.segments
    rows: list[TableRow] = []
    sources: list[Iterator[CanItem | TableItem]] = [_frames(info, spool), _rows(info, recording)]
    try:
        for item in merge(*sources, key=attrgetter("t_mono_ns")):
            if done - written >= BATCH and item.t_mono_ns != newest_ns:  # a chunk does not part what is of one instant
                writer.write(rows)
                writer.close_chunk_if_due(newest_ns)
                rows, written = [], done
                writing(done, of)
            newest_ns, done = item.t_mono_ns, done + 1
            if isinstance(item, TableItem):
                rows.append(("measurements", (newest_ns, item.t_wall_ns, item.numbers.tobytes())))
            else:
                rows.append(("can_frames", (newest_ns, item.t_wall_ns, item.can_id, item.data, 0)))
            output = pipeline.feed(item)
            if not output.is_nothing:
                pipeline.predict()
                rows += _made(output, newest_ns, segments)
        rows += _made(pipeline.tick(end_ns, end_wall_ns), end_ns, segments)  # no frame ends the last period
        writer.write(rows)
        writer.close(end_ns, end_wall_ns)
        writing(of, of)
    finally:
        writer.abandon()
    ended = replace(info, ended_mono_ns=end_ns, ended_wall_ns=end_wall_ns)
    if log is not None:
        return ImportedSession(ended, len(log.time_s), log.n_cells, recording.notes)
    return ImportedSession(ended, of, len(writer.cells), (*recording.notes, *_notes(info, recording.battery, writer)))


def _frames(info: SessionInfo, spool: FrameSpool) -> Iterator[CanItem]:
    first_s, wall_of_mono_ns = spool.first_s, info.started_wall_ns - START_MONO_NS
    for at_s, can_id, data in spool:
        mono_ns = START_MONO_NS + round((at_s - first_s) * 1e9)
        yield CanItem(mono_ns, mono_ns + wall_of_mono_ns, can_id, data)


def _rows(info: SessionInfo, recording: _Recording) -> Iterator[TableItem]:
    log, wall_of_mono_ns = recording.log, info.started_wall_ns - START_MONO_NS
    if log is None:
        return
    for time_s, numbers in zip(log.time_s.tolist(), numbers_of_rows(log, recording.battery.battery), strict=True):
        mono_ns = START_MONO_NS + recording.later_ns + round(time_s * 1e9)
        yield TableItem(mono_ns, mono_ns + wall_of_mono_ns, numbers)


def _made(output: Output, mono_ns: int, segments: Sequence[int]) -> Iterator[TableRow]:
    if (estimates := output.estimates) is not None:
        yield "estimates", (output.t_mono_ns, output.uptime_ms, estimates.soc, estimates.soc_sigma)
    for event in output.events:
        yield event_row(mono_ns, event, segments)


def _notes(info: SessionInfo, battery: LoadedBattery, writer: SessionWriter) -> Iterator[Message]:
    """What a log of frames says of its battery.

    Raises:
        ImportFailed: it is the log of another one.
    """
    if battery.mapping is None:
        yield Message("own-master")
        return
    received, n_cells = len(writer.cells), battery.battery.n_cells
    if not received:
        raise ImportFailed(
            str(info.metadata["imported_from"]), Message("no-voltage-of-battery", name=battery.battery.name)
        )
    if received < n_cells:
        yield Message("cells-not-received", silent=n_cells - received, cells=n_cells)
    if writer.bad_checksums:
        yield Message("wrong-checksums", frames=writer.bad_checksums)
    if writer.absent_values:
        yield Message("absent-sensors", values=writer.absent_values)
